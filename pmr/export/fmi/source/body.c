#include "body.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "contact.h"
#include "dense.h"
#include "drive.h"
#include "friction.h"
#include "rows.h"

/* A change of the forces of terms that is so many times as large as these diverges. */
#define DIVERGED 1e6

int fail(Body *body, const char *why)
{
    snprintf(body->message, sizeof body->message, "%s", why);
    return 1;
}

/* result += factor * T x, for T (ROWS, width). */
void add(const double *T, int width, const double *x, double factor, double *result)
{
    int k, n;
    for (k = 0; k < ROWS; k++) {
        double sum = 0.0;
        for (n = 0; n < width; n++) sum += T[k * width + n] * x[n];
        result[k] += factor * sum;
    }
}

/* motion += C z + H f - F multipliers; NULL: there are none. */
void add_motion(const Rows *rows, const double *z, const double *f, const double *multipliers, double *motion)
{
    add(rows->C[0], MODES, z, 1.0, motion);
    add(rows->H[0], INPUTS, f, 1.0, motion);
    if (multipliers) add(rows->F[0], ROWS, multipliers, -1.0, motion);
}

/* forces -= C^T multipliers, or another table with values (ROWS, MODES). */
void subtract_rows(const double *C, const double *multipliers, double *forces)
{
    int k, n;
    for (k = 0; k < ROWS; k++)
        for (n = 0; n < MODES; n++) forces[n] -= C[k * MODES + n] * multipliers[k];
}

/* Forces on the modes: B f - D v - Omega^2 z. */
void free_forces(const double *f, const double *z, const double *v, double *forces)
{
    int n, l;
    for (n = 0; n < MODES; n++) forces[n] = -omega2[n] * z[n];
#if DAMPING_COUPLES
    for (n = 0; n < MODES; n++)
        for (l = 0; l < MODES; l++) forces[n] -= damping[n * MODES + l] * v[l];
#else
    for (n = 0; n < MODES; n++) forces[n] -= damping[n] * v[n];
#endif
    for (l = 0; l < INPUTS; l++)
        for (n = 0; n < MODES; n++) forces[n] += inputs[l][n] * f[l];
}

/* Accelerations S^-1 x with S = 1 + D dv + Omega^2 dz. */
static void over_S(const Scheme *scheme, const double *x, double *result)
{
    int n;
#if DAMPING_COUPLES
    int l;
    for (n = 0; n < MODES; n++) {
        result[n] = 0.0;
        for (l = 0; l < MODES; l++) result[n] += scheme->inverse[n * MODES + l] * x[l];
    }
#else
    for (n = 0; n < MODES; n++) result[n] = scheme->inverse[n] * x[n];
#endif
}

int set_scheme(Body *body, double step, double rho_inf)
{
    Scheme *scheme;
    int n;
    for (n = 0; n < SCHEMES; n++) {
        scheme = body->scheme = body->schemes + n;
        if (scheme->step == step && scheme->rho_inf == rho_inf) return 0;
    }
    scheme = body->scheme = body->schemes + body->next_scheme;
    body->next_scheme = (body->next_scheme + 1) % SCHEMES;
    scheme->step = step;
    scheme->rho_inf = rho_inf;
    scheme->alpha_m = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0); /* Chung, Hulbert 1993, eq. 25 */
    scheme->alpha_f = rho_inf / (rho_inf + 1.0);
    scheme->gamma = 0.5 + scheme->alpha_f - scheme->alpha_m;
    scheme->beta = (scheme->gamma + 0.5) * (scheme->gamma + 0.5) / 4.0;
    scheme->gain = (1.0 - scheme->alpha_f) / (1.0 - scheme->alpha_m);
    scheme->dz = step * step * scheme->beta * scheme->gain;
    scheme->dv = step * scheme->gamma * scheme->gain;
#if DAMPING_COUPLES
    {
        int l;
        for (l = 0; l < MODES; l++) { /* column l, which is row l too */
            double S[MODES * MODES], *column = scheme->inverse + l * MODES;
            for (n = 0; n < MODES * MODES; n++)
                S[n] = damping[n] * (quasi_static[n % MODES] ? scheme->dz / step : scheme->dv);
            for (n = 0; n < MODES; n++) {
                S[n * MODES + n] += (quasi_static[n] ? 0.0 : 1.0) + omega2[n] * scheme->dz;
                column[n] = n == l;
            }
            if (solve_dense(MODES, S, column)) {
                scheme->step = 0.0;
                return fail(body, "the damping makes the step singular");
            }
        }
    }
#else
    for (n = 0; n < MODES; n++)
        scheme->inverse[n] = quasi_static[n] ? 1.0 / (scheme->dz * (damping[n] / step + omega2[n]))
                                             : 1.0 / (1.0 + damping[n] * scheme->dv + omega2[n] * scheme->dz);
#endif
    return 0;
}

/* y = O z + W f. */
static void add_global(const double *z, const double *f, double *y)
{
    int n, l;
    for (n = 0; n < OUTPUTS; n++) y[n] = 0.0;
    for (l = 0; l < MODES; l++)
        for (n = 0; n < OUTPUTS; n++) y[n] += shapes[l][n] * z[l];
    for (l = 0; l < INPUTS; l++)
        for (n = 0; n < OUTPUTS; n++) y[n] += direct[l][n] * f[l];
}

/* Multipliers of the rows that give way, from the position; those of rigid ones as the last step left them. */
int find_multipliers(Body *body)
{
    const double *u = body->memory.variables;
    Rows *rows = &body->place.rows;
    double motion[ROWS] = {0.0};
    int k;
    if (place(body)) return 1;
    find_drive(body, VALUES, NULL);
    add_motion(rows, u + STATES, body->drive.f, NULL, motion);
    take_friction(body);
    subtract_friction(body, rows->F, motion);
    if (settle(body, rows->F, motion, gives_way, body->multipliers)) return 1;
    for (k = 0; k < ROWS; k++)
        if (!gives_way[k]) body->multipliers[k] = body->memory.multipliers[k];
    return 0;
}

void body_changed(Body *body) { body->fresh = body->moving = body->drive.known = 0; }

void body_reset(Body *body)
{
    int k;
    memset(body, 0, sizeof *body);
    memcpy(body->memory.variables, start_values, sizeof start_values);
    for (k = 0; k < ROWS; k++) body->memory.closed[k] = k < CONTACTS && !pushes[k];
}

int body_evaluate(Body *body)
{
    double *u = body->memory.variables, *v = u + STATES + MODES, pushed[PUSHED] = {0.0};
    int n;
    if (body->fresh) return 0;
    if (find_multipliers(body)) return 1;
    for (n = 0; n < MODES; n++) u[DERIVATIVES + n] = v[n];
    free_forces(body->drive.f, u + STATES, v, u + DERIVATIVES + MODES);
    subtract_rows(body->place.rows.C[0], body->multipliers, u + DERIVATIVES + MODES);
#if TERMS
    subtract_terms(body->drive.T, u + STATES, pushed);
    for (n = 0; n < MODES; n++) u[DERIVATIVES + MODES + n] += pushed[n];
#endif
    add_global(u + STATES, body->drive.f, u + DISPLACEMENTS);
    add_local(body, NULL, NULL, body->multipliers, -1.0, u + DISPLACEMENTS);
    memcpy(u + FORCES, body->multipliers, CONTACTS * sizeof(double));
    add_to_cylinders(body, u + FORCES);
    add_outputs(body, NULL, v, pushed, u);
    body->fresh = 1;
    return 0;
}

/* Multipliers of the rows that give way, from what moves these; zero in rigid ones, which deform nothing. */
static int solve_giving(Body *body, double *motion_to_multipliers)
{
    int k;
    if (solve_closed(body, body->place.rows.F, gives_way, motion_to_multipliers)) return 1;
    for (k = 0; k < ROWS; k++)
        if (!gives_way[k]) motion_to_multipliers[k] = 0.0;
    return 0;
}

/* Rates of the multipliers that follow from the position: F lambda' = (C z + H f)' - F' lambda. */
int body_velocities(Body *body)
{
    double *u = body->memory.variables, *rates = body->rates;
    const double *ds = u + PATH_RATE, *multipliers = body->multipliers;
    Rows moving;
    if (body->moving) return 0;
    if (body_evaluate(body)) return 1;
    find_drive(body, RATES, NULL);
    change(body, ds, NULL, &moving);
    memset(body->rates, 0, sizeof body->rates);
    add_motion(&body->place.rows, u + STATES + MODES, body->drive.f_rate, NULL, rates);
    add_motion(&moving, u + STATES, body->drive.f, multipliers, rates);
    if (solve_giving(body, rates)) return 1;
    add_global(u + STATES + MODES, body->drive.f_rate, u + VELOCITIES);
    add_local(body, NULL, NULL, rates, -1.0, u + VELOCITIES);
    add_local(body, ds, NULL, multipliers, -1.0, u + VELOCITIES);
    add_output_rates(body, NULL, u);
    body->moving = 1;
    return 0;
}

/* The two above, differentiated along a direction of states and inputs. */
int body_differentiate(Body *body, const double *seed, double *answer)
{
    const double *u = body->memory.variables, *z = u + STATES, *v = z + MODES, *f = body->drive.f, *df = body->drive.f_rate;
    const double *of_z = seed + STATES, *of_v = of_z + MODES, *of_f = body->drive.f_along, *of_df = body->drive.f_both;
    const double *ds = u + PATH_RATE, *of_s = seed + PATH, *of_ds = seed + PATH_RATE, *multipliers = body->multipliers;
    double forces[ROWS] = {0.0}, rates[ROWS] = {0.0}, pushed[PUSHED] = {0.0};
    const Rows *rows = &body->place.rows;
    Rows moving, by_s, by_rate, by_both;
    if (body_velocities(body)) return 1;
    find_drive(body, RATES, seed);
    change(body, ds, NULL, &moving);
    change(body, of_s, NULL, &by_s);
    change(body, of_ds, NULL, &by_rate);
    change(body, ds, of_s, &by_both);
    add_motion(rows, of_z, of_f, NULL, forces);
    add_motion(&by_s, z, f, multipliers, forces);
    if (solve_giving(body, forces)) return 1;
    add_motion(rows, of_v, of_df, NULL, rates);
    add_motion(&by_rate, z, f, multipliers, rates);
    add_motion(&moving, of_z, of_f, forces, rates);
    add_motion(&by_s, v, df, body->rates, rates);
    add_motion(&by_both, z, f, multipliers, rates);
    if (solve_giving(body, rates)) return 1;
    memcpy(answer + DERIVATIVES, of_v, MODES * sizeof(double));
    free_forces(of_f, of_z, of_v, answer + DERIVATIVES + MODES);
    subtract_rows(rows->C[0], forces, answer + DERIVATIVES + MODES);
    subtract_rows(by_s.C[0], multipliers, answer + DERIVATIVES + MODES);
#if TERMS
    {
        int n;
        subtract_terms(body->drive.T, of_z, pushed);
        subtract_terms(body->drive.T_along, z, pushed);
        for (n = 0; n < MODES; n++) answer[DERIVATIVES + MODES + n] += pushed[n];
    }
#endif
    add_global(of_z, of_f, answer + DISPLACEMENTS);
    add_local(body, NULL, NULL, forces, -1.0, answer + DISPLACEMENTS);
    add_local(body, of_s, NULL, multipliers, -1.0, answer + DISPLACEMENTS);
    memcpy(answer + FORCES, forces, CONTACTS * sizeof(double));
    add_outputs(body, seed, of_v, pushed, answer);
    add_global(of_v, of_df, answer + VELOCITIES);
    add_local(body, NULL, NULL, rates, -1.0, answer + VELOCITIES);
    add_local(body, ds, NULL, forces, -1.0, answer + VELOCITIES);
    add_local(body, of_ds, NULL, multipliers, -1.0, answer + VELOCITIES);
    add_local(body, of_s, NULL, body->rates, -1.0, answer + VELOCITIES);
    add_local(body, ds, of_s, multipliers, -1.0, answer + VELOCITIES);
    add_output_rates(body, seed, answer);
    return 0;
}

/* What a step leads to without its own acceleration: displacement, rate and acceleration-like variable.  Quasi-static modes
   keep what their damping does of where they were. */
static void predict(const Body *body, double *z0, double *v0, double *a0)
{
    const Scheme *scheme = body->scheme;
    const Memory *memory = &body->memory;
    const double *z = memory->variables + STATES, *v = z + MODES;
    double h = scheme->step;
    int n;
    for (n = 0; n < MODES; n++) {
        double left = (scheme->alpha_f * memory->acceleration[n] - scheme->alpha_m * memory->alike[n]) / (1.0 - scheme->alpha_m);
        a0[n] = left;
        z0[n] = z[n] + h * v[n] + h * h * ((0.5 - scheme->beta) * memory->alike[n] + scheme->beta * left);
        v0[n] = v[n] + h * ((1.0 - scheme->gamma) * memory->alike[n] + scheme->gamma * left);
        if (quasi_static[n]) {
            const double c = damping[DAMPING_COUPLES ? n * MODES + n : n];
            z0[n] = z[n] * c / (c + h * omega2[n]);
            v0[n] = a0[n] = 0.0;
        }
    }
}

/* Forces of terms at the end of a step, as the steps before go on: of a cubic. */
static void expect_terms(Memory *memory, double *forces)
{
    int n;
    for (n = 0; n < MODES; n++)
        forces[n] = 4.0 * (memory->pushed[0][n] + memory->pushed[2][n]) - 6.0 * memory->pushed[1][n] - memory->pushed[3][n];
}

/* Whether forces of terms are those that displacements z and rates v make of them; if not, they are these afterwards: 0, 1, or
   less than 0 where they do not converge. */
static int revise_terms(Body *body, const double *z, const double *v, int times, double *forces)
{
#if TERMS
    double x[2 * MODES], found[PUSHED] = {0.0}, change = 0.0, size = 0.0;
    int n;
    memcpy(x, z, MODES * sizeof(double));
    memcpy(x + MODES, v, MODES * sizeof(double));
    subtract_terms(body->drive.T, x, found);
    for (n = 0; n < MODES; n++) {
        change += (found[n] - forces[n]) * (found[n] - forces[n]);
        size += found[n] * found[n];
    }
    size = fmax(size, body->memory.largest);
    if (!(change > CONVERGED * CONVERGED * size) || (times == MOST_TIMES && change <= ACCEPTED * ACCEPTED * size)) {
        body->memory.largest = size; /* what is not a number is said elsewhere */
        return 0;
    }
    if (times == MOST_TIMES || (times > 1 && change > DIVERGED * DIVERGED * size)) return -1;
    memcpy(forces, found, MODES * sizeof(double));
    return 1;
#else
    (void)body, (void)z, (void)v, (void)times, (void)forces;
    return 0;
#endif
}

/* Multipliers, and the acceleration of the step, under forces S^-1 (...) that rows and terms are not among. */
static int find_step(Body *body, double pulled[ROWS][MODES], const double *z0, const double *v0, double *pushed,
                     double *acceleration)
{
    const Scheme *scheme = body->scheme;
    double forces[MODES], rest[MODES] = {0.0}, z[MODES], v[MODES], motion[ROWS];
    int all[ROWS], again, rubs, times, k, n;
    for (k = 0; k < ROWS; k++) all[k] = k < CONTACTS;
    for (n = 0; n < MODES; n++) rest[n] = quasi_static[n] ? 0.0 : z0[n];
    free_forces(body->drive.f, rest, v0, forces);
    for (times = 1;; times++) {
        for (n = 0; n < MODES; n++) rest[n] = forces[n] + pushed[n];
        over_S(scheme, rest, acceleration);
        for (n = 0; n < MODES; n++) z[n] = z0[n] + scheme->dz * acceleration[n];
        memset(motion, 0, sizeof motion);
        add_motion(&body->place.rows, z, body->drive.f, NULL, motion);
        subtract_friction(body, body->A, motion);
        if (settle(body, body->A, motion, all, body->multipliers)) return 1;
        subtract_rows(pulled[0], body->multipliers, acceleration);
        for (n = 0; n < MODES; n++) {
            z[n] = z0[n] + scheme->dz * acceleration[n];
            v[n] = v0[n] + scheme->dv * acceleration[n];
        }
        again = revise_terms(body, z, v, times, pushed);
        if (again < 0)
            return fail(body, "the forces of second order do not converge: shorter steps help where tension, pressure or spin "
                              "change the stiffness of a step as much as it is");
        rubs = revise_friction(body, times);
        if (rubs < 0) return fail(body, "friction does not converge: pads stick and slide, close and open again and again within a step");
        if (!again && !rubs) return 0;
    }
}

int take_step(Body *body)
{
    const Scheme *scheme = body->scheme;
    const Rows *rows = &body->place.rows;
    Memory *memory = &body->memory;
    double *z = memory->variables + STATES, *v = z + MODES;
    double z0[MODES], v0[MODES], a0[MODES], acceleration[MODES], pushed[MODES], pulled[ROWS][MODES];
    int all[ROWS], k, l, n;
    if (place(body)) return 1;
    find_drive(body, VALUES, NULL);
    for (k = 0; k < ROWS; k++) all[k] = k < CONTACTS;
    for (k = 0; k < ROWS; k++) over_S(scheme, rows->C[k], pulled[k]);
    for (k = 0; k < ROWS; k++)
        for (l = 0; l <= k; l++) {
            double sum = 0.0;
            for (n = 0; n < MODES; n++) sum += pulled[k][n] * rows->C[l][n];
            body->A[k][l] = body->A[l][k] = rows->F[k][l] + scheme->dz * sum;
        }
    expect_terms(memory, pushed);
    take_friction(body);
    do {
        predict(body, z0, v0, a0);
        if (find_step(body, pulled, z0, v0, pushed, acceleration)) return 1;
    } while (let_go(body, all));
    for (n = 0; n < MODES; n++) {
        double before = z[n];
        memory->acceleration[n] = quasi_static[n] ? 0.0 : acceleration[n];
        memory->alike[n] = quasi_static[n] ? 0.0 : a0[n] + scheme->gain * acceleration[n];
        z[n] = z0[n] + scheme->dz * acceleration[n];
        v[n] = quasi_static[n] ? (z[n] - before) / scheme->step : v0[n] + scheme->dv * acceleration[n];
    }
    for (k = 3; k > 0; k--) memcpy(memory->pushed[k], memory->pushed[k - 1], sizeof memory->pushed[k]);
    memcpy(memory->pushed[0], pushed, sizeof pushed);
    memcpy(memory->multipliers, body->multipliers, sizeof memory->multipliers);
    remember(body);
    remember_friction(body);
    return 0;
}
