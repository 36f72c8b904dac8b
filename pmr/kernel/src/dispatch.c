/* The interface: calls go to the code for this processor, which is found when first asked for. */
#include "internal.h"

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

int pmr_state_open(const pmr_system *system, const pmr_settings *settings, pmr_state **state, char *why)
{
    return chosen()->state_open(system, settings, state, why);
}

void pmr_state_close(pmr_state *state) { pmr_free_aligned(state); }

size_t pmr_state_bytes(const pmr_state *state) { return chosen()->state_bytes(state); }

size_t pmr_state_memory(const pmr_state *state) { return state->memory; }

void pmr_state_save(const pmr_state *state, void *bytes) { chosen()->state_save(state, bytes); }

int pmr_state_restore(pmr_state *state, const void *bytes, size_t count, char *why)
{
    return chosen()->state_restore(state, bytes, count, why);
}

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

int pmr_start(pmr_state *state, int kind, const double *u, const double *z, const double *v)
{
    return chosen()->start(state, kind, u, NULL, z, v);
}

int pmr_start_moving(pmr_state *state, int kind, const double *u, const double *rates, const double *z, const double *v)
{
    return chosen()->start(state, kind, u, rates, z, v);
}

int pmr_start_from(pmr_state *state, const double *u, const double *z, const double *v, const double *a,
                   const double *multipliers, const int32_t *closed)
{
    return chosen()->start_from(state, u, z, v, a, multipliers, closed);
}

int pmr_step(pmr_state *state, const double *u, const double *rates) { return chosen()->step(state, u, rates); }

int pmr_frame(const pmr_system *system, const double *motions, double *u, double *jacobian, double *work)
{
    return jacobian ? pmr_frame_derivatives(system, motions, u, jacobian, work)
                    : pmr_frame_drivers(system, motions, u, work);
}

size_t pmr_frame_work(const pmr_system *system)
{
    return 2 * (size_t)system->quantities + 3 * (size_t)system->motions + (size_t)system->drivers + 1;
}

int pmr_start_in_frame(pmr_state *state, int kind, const double *motions, const int32_t *rows, const double *z,
                       const double *v)
{
    return chosen()->start_in_frame(state, kind, motions, rows, z, v);
}

int pmr_step_in_frame(pmr_state *state, const double *motions, const int32_t *rows)
{
    return chosen()->step_in_frame(state, motions, rows);
}

int pmr_step_led(pmr_state *state, const double *led, double since) { return chosen()->step_led(state, led, since); }

int pmr_state_adjust(pmr_state *state, const pmr_settings *settings, char *why)
{
    return chosen()->state_adjust(state, settings, why);
}

int pmr_carried_open(pmr_state *state, const pmr_machine *machine, pmr_carried **carried)
{
    return chosen()->carried_open(state, machine, carried);
}

void pmr_carried_close(pmr_carried *carried) { pmr_free_aligned(carried); }

int pmr_carried_needed(pmr_carried *carried, const double *b, const double *z, const double *v, const double *a,
                       double *needed)
{
    return chosen()->carried_needed(carried, b, z, v, a, needed);
}

int pmr_carried_start(pmr_carried *carried, const double *b, const double *z, const double *v,
                      const pmr_carried_record *record)
{
    return chosen()->carried_start(carried, b, z, v, record);
}

int pmr_carried_advance(pmr_carried *carried, int64_t first, int64_t count, const pmr_carried_record *record,
                        int64_t *taken)
{
    return chosen()->carried_advance(carried, first, count, record, taken);
}

int pmr_advance(pmr_state *state, const pmr_signals *signals, int64_t count, int64_t every, const int32_t *parts,
                const pmr_record *record, int64_t *taken)
{
    return chosen()->advance(state, signals, count, every, parts, record, taken);
}

int pmr_advance_sampled(pmr_state *state, const double *u, int per, int64_t count, int64_t every, const int32_t *parts,
                        const pmr_record *record, int64_t *taken, int *needed)
{
    return chosen()->advance_sampled(state, u, per, count, every, parts, record, taken, needed);
}

void pmr_outputs(pmr_state *state, double *y, double *forces) { chosen()->outputs(state, y, forces); }

void pmr_observe(pmr_state *state, int count, const int32_t *numbers, double *values)
{
    chosen()->observe(state, count, numbers, values);
}

void pmr_further(pmr_state *state, double *further) { chosen()->further(state, further); }

int pmr_evaluate(pmr_state *state, const double *at, int hold, const pmr_values *values)
{
    return chosen()->evaluate(state, at, hold, values);
}

int pmr_evaluate_along(pmr_state *state, const double *at, const double *seed, const double *z, const double *v,
                       int hold, const pmr_values *values)
{
    return chosen()->evaluate_along(state, at, seed, z, v, hold, values);
}

int pmr_check_start(pmr_state *state, const double *at, const double *rates, const double *z, const double *v,
                    char *why)
{
    return chosen()->check_start(state, at, rates, z, v, why);
}

void pmr_energy(const pmr_state *state, double *energy) { memcpy(energy, state->energy, 2 * sizeof(double)); }

int pmr_linearize(pmr_state *state, const double *u, const pmr_jacobian *jacobian)
{
    return chosen()->linearize(state, u, jacobian);
}

size_t pmr_contact_work(int m) { return m < 0 ? 0 : (size_t)m * m + 4 * (size_t)m + 1; }

int pmr_contact(int m, const double *A, const double *b, const int32_t *pushes, double *lambda, int32_t *closed,
                double *work, int *trouble)
{
    return m < 0 ? PMR_REFUSED : chosen()->contact(m, A, b, pushes, lambda, closed, work, trouble);
}

int pmr_choose_changes(int m, int32_t *wrong, pmr_search *search)
{
    return chosen()->choose_changes(m, wrong, search);
}

void pmr_restart(pmr_iteration *iteration) { iteration->pairs = iteration->begun = 0; }

void pmr_extrapolate(pmr_iteration *iteration) { chosen()->extrapolate(iteration); }

void pmr_scheme_factors(double h, double rho_inf, pmr_factors *factors) { chosen()->factors(h, rho_inf, factors); }

double pmr_friction(int n, const double *kappa, const double *laws, const double *forces, const double *old,
                    double moved, double speed, const pmr_cylinder *cylinder, double *limits, double *f)
{
    return chosen()->friction(n, kappa, laws, forces, old, moved, speed, cylinder, limits, f);
}
