/* A program around the kernel: 60 steps of a system in a file, and checksum and coordinates of what comes out. */
#include <stdio.h>
#include <stdlib.h>

#include "pmr_kernel.h"

int main(int count, char **arguments)
{
    static _Alignas(64) unsigned char block[1 << 20];
    char why[PMR_MESSAGE] = "";
    FILE *file = fopen(arguments[count - 1], "rb");
    size_t bytes = file ? fread(block, 1, sizeof(block), file) : 0;
    pmr_system *system = NULL;
    pmr_state *state = NULL;
    pmr_settings settings = {1e-3, 0.8, 0.0, 0.0, 1, 1, NULL};
    if (pmr_system_open(block, bytes, &system, why) || pmr_state_open(system, &settings, &state, why)) {
        puts(why);
        return 1;
    }
    pmr_sizes sizes;
    pmr_view view;
    pmr_system_sizes(system, &sizes);
    pmr_state_view(state, &view);
    double *u = calloc((size_t)sizes.drivers, sizeof(double));
    for (int step = 0; step <= 60; step++) {
        for (int n = 0; n < sizes.drivers; n++)
            u[n] = n < sizes.paths ? 2.0 + 1e-4 * step * (n + 1) : 100.0 * step;
        if (step ? pmr_step(state, u, NULL) : pmr_start(state, PMR_AT_REST, u, NULL, NULL))
            return 2;
    }
    printf("%s", pmr_variant());
    for (int k = 0; k < sizes.modes; k++)
        printf(" %.17g", view.z[k]);
    pmr_state_close(state);
    pmr_system_close(system);
    return 0;
}
