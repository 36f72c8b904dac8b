/* The interface: calls go to the code for this processor, which is found when first asked for. */
#include "internal.h"
#include "law.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#if defined __x86_64__ && defined __GNUC__ && !defined PMR_PLAIN
/* __builtin_cpu_supports asks for a symbol that ziglang's library lacks. */
#include <cpuid.h>

static int has_avx2(void)
{
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & (1u << 27)) || !(c & (1u << 12))) return 0; /* OSXSAVE, FMA */
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if ((low & 6) != 6 || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 0; /* the system saves such registers */
    return (b & (1u << 5)) && (b & (1u << 8));                                /* AVX2, BMI2 */
}

static const pmr_functions *chosen(void)
{
    static const pmr_functions *functions; /* two threads that begin at once write the same */
    const pmr_functions *known = __atomic_load_n(&functions, __ATOMIC_RELAXED);
    if (known) return known;
    known = has_avx2() && !getenv("PMR_KERNEL_BASELINE") ? &pmr_functions_avx2 : &pmr_functions_baseline;
    __atomic_store_n(&functions, known, __ATOMIC_RELAXED);
    return known;
}
#else
static const pmr_functions *chosen(void) { return &pmr_functions_baseline; }
#endif

const char *pmr_variant(void) { return chosen()->name; }

#define FORWARD(result, name, code, parameters, arguments) \
    result pmr_##name parameters { return chosen()->name arguments; }
#define FORWARD_VOID(name, code, parameters, arguments) \
    void pmr_##name parameters { chosen()->name arguments; }
PMR_OF_VARIANTS(FORWARD, FORWARD_VOID)

int pmr_start(pmr_state *state, int kind, const double *u, const double *z, const double *v)
{
    return pmr_start_moving(state, kind, u, NULL, z, v);
}

int pmr_evaluate(pmr_state *state, const double *at, int hold, const pmr_values *values)
{
    return pmr_evaluate_along(state, at, NULL, NULL, NULL, hold, values);
}

int pmr_take_motions(int n, double step, const double *given, const double *limits, double *motions)
{
    int k, j;
    for (k = 0; k < n; k++) {
        const double value = given[k], rate = given[n + k], second = given[2 * n + k], change = value - motions[k];
        const double *most = limits + k;
        if (isnan(*most)) continue;
        if (!(value >= most[0] && value <= most[n] && fabs(change) <= most[2 * n] && fabs(rate) <= most[3 * n] &&
              isfinite(second)) ||
            (second == 0.0 && motions[2 * n + k] == 0.0 && fabs(change - step * motions[n + k]) > most[4 * n]))
            return k;
    }
    for (k = 0; k < n; k++)
        for (j = 0; j < 3 && !isnan(limits[k]); j++) motions[j * n + k] = given[j * n + k];
    return -1;
}

/* Share of the larger one by which changes of a motion and the integral of its rates may differ. */
#define DIFFER 0.5

int pmr_compare_rates(int n, double step, const double *motions, double *book)
{
    int k, differ = 0;
    for (k = 0; k < n; k++) {
        double *before = book + k, *moved = book + 2 * n + k, *led = book + 3 * n + k, *distance = book + 4 * n + k;
        const double value = motions[k], rate = motions[n + k];
        if (*distance > 0.0 && rate != 0.0 && before[n] != 0.0) {
            *moved += value - *before;
            *led += step * (before[n] + rate) / 2.0;
            if (fmax(fabs(*moved), fabs(*led)) > *distance) {
                *distance = fabs(*moved - *led) > DIFFER * fmax(fabs(*moved), fabs(*led)) ? -1.0 : 0.0;
                differ += *distance < 0.0;
            }
        }
        *before = value;
        before[n] = rate;
    }
    return differ;
}

static double limited_sum(const pmr_limits *w, int k)
{
    double sum = 0.0;
    int n;
    for (n = w->first[k]; n < w->first[k + 1]; n++) sum += w->shares[n] * w->values[n];
    return sum;
}

int pmr_beyond(const pmr_limits *w, int count)
{
    double *sizes = w->largest + w->count;
    int k;
    for (k = 0; k < count; k++) {
        const int family = w->family[k];
        double sum;
        if (family < 0) continue;
        sum = limited_sum(w, k);
        if (sum > w->largest[k]) w->largest[k] = sum;
        if (fabs(sum) > sizes[family]) sizes[family] = fabs(sum);
    }
    for (k = 0; k < count; k++) {
        const int family = w->family[k];
        double low = w->limits[2 * k], sum;
        if (w->warned[w->groups[k]] || (w->until[k] >= 0 && w->warned[w->until[k]])) continue;
        if (family >= 0) low = fmin(low, -w->law[0] * fmax(w->largest[k], w->law[1] * sizes[family]));
        sum = limited_sum(w, k);
        if (sum >= low && sum <= w->limits[2 * k + 1]) continue;
        w->warned[w->groups[k]] = 1;
        return k;
    }
    return -1;
}

int pmr_watch(pmr_state *state, const pmr_limits *w) { return -1 - pmr_observe_and_watch(state, 0, w->numbers, NULL, w); }

void pmr_state_close(pmr_state *state) { pmr_free_aligned(state); }

size_t pmr_state_memory(const pmr_state *state) { return state->memory; }

int pmr_state_trouble(const pmr_state *state) { return state->trouble; }

void pmr_state_view(pmr_state *state, pmr_view *view)
{
    view->z = state->z;
    view->v = state->v;
    view->multipliers = state->lambda;
    view->impulses = state->impulse;
    view->energy = state->energy;
    view->friction = state->friction;
    view->drivers = state->u;
    view->step = &state->progress.step;
    view->parts = &state->progress.parts;
}

int pmr_frame(const pmr_system *system, const double *motions, double *u, double *work)
{
    return pmr_frame_drivers(system, motions, u, work);
}

size_t pmr_frame_work(const pmr_system *system)
{
    return 2 * (size_t)system->quantities + 1;
}

void pmr_machine_run_close(pmr_machine_run *run) { pmr_free_aligned(run); }

size_t pmr_contact_work(int m) { return m < 0 ? 0 : (size_t)m * m + 4 * (size_t)m + 1; }


void pmr_restart(pmr_iteration *iteration) { iteration->pairs = iteration->begun = 0; }

