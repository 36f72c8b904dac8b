/* A machine that carries the frame of a boom and moves by itself: its motion is found with the boom's, step by step.

   With P and L the linear and angular momentum of machine and boom about the ground's origin, along its axes,

       P_{n+1} = P_n + h F~,    L_{n+1} = L_n + h M~

   hold to round-off in the directions that are free.  F~ are forces from outside as generalized-alpha averages them,

       (1 - alpha_m) F~_{n+1} + alpha_m F~_n = (1 - alpha_f) F_{n+1} + alpha_f F_n,

   and the machine's rates follow from its accelerations in the same way.  The rates of the free directions are found by
   Newton's method with Broyden's secants; each trial takes the boom's step in the frame that moves so.

   The boom's momentum is that of all its points.  With the moments mu_{lj} = int rho r_l u_j of each section (r_0 = 1),

       mu = beta(s) z + delta_jx z^T G z / 2,    beta z = B^T z - H^T lambda_0,    F lambda_0 = C z,

   of which B^T z is what inputs of unit acceleration do to modes, H^T lambda_0 what contacts that give way answer.
   `pmr.simulation.free_base` has the equations. */

enum { MOST_TRIALS = 30, PATIENCE = 6 };
/* Of the fastest motion so far: to which rates are found; the same where a further trial comes no nearer; by which rates
   differ for a derivative. Cosine of pitch where roll and yaw turn about almost the same axis. */
#define MACHINE_ROUND_OFF 1e-12
#define MACHINE_NEAR 1e-9
#define MACHINE_DIFFERENCE 1e-4
#define MACHINE_UPRIGHT 0.02

/* ---- generalized-alpha where rates are known and accelerations follow ---- */

static double smoothed(const weights *w, double now, double old, double before)
{
    return ((1.0 - w->af) * now + w->af * old - w->am * before) / (1.0 - w->am);
}

static double of_smoothed(const weights *w, double smooth, double before, double old)
{
    return ((1.0 - w->am) * smooth + w->am * before - w->af * old) / (1.0 - w->af);
}

static double by_impulse(const weights *w, double impulse, double before)
{
    return (impulse / w->h - (1.0 - w->gamma) * before) / w->gamma;
}

/* ---- a step ---- */

static void store_luffing(pmr_machine_run *ms);

static void save_boom(pmr_machine_run *ms)
{
    memcpy(ms->saved, ms->state->mark, ms->state->stepped * sizeof(double));
    ms->progress = ms->state->progress;
}

static void restore_boom(pmr_machine_run *ms)
{
    memcpy(ms->state->mark, ms->saved, ms->state->stepped * sizeof(double));
    ms->state->progress = ms->progress;
}

/* End a step, or the start, with what the next one begins with. */
static void store_end(pmr_machine_run *ms)
{
    if (ms->state->run == ms)
        store_luffing(ms);
    else
        save_boom(ms);
}

/* Tell the boom's state the frame's motions, of which further outputs are; second rates of directions that are not free
   are as they are given. */
static void tell_motions(const pmr_machine_run *ms, int64_t k, const double *b)
{
    const int count = ms->state->system->motions;
    double second[6];
    int n;
    for (n = 0; n < 6; n++) second[n] = ms->machine->free[n] ? b[12 + n] : ms->machine->base_motion[18 * (size_t)k + 12 + n];
    copy(ms->state->motions, motions_at(ms, k, b, second), 3 * count);
    for (n = 0; n < count; n++) ms->state->motions[3 * count + n] = 3.0;
}

/* Step k in which free directions end with such rates (6,), those of others left out, from where the boom began it. */
static int try_rates(pmr_machine_run *ms, int64_t k, const double *rates)
{
    const pmr_machine *m = ms->machine;
    const pmr_system *y = ms->state->system;
    const machine_past *old = &ms->past;
    const weights w = weights_of(ms->state->settings.step, ms->state->settings.rho_inf);
    trial *now = &ms->now;
    const double *z[3], *loads = ms->u + y->paths, *old_loads = ms->u_old + y->paths;
    double second[6], left[6], middle[3];
    int free = 0, failed, n, i, j;
    copy(now->b, m->base_motion + 18 * (size_t)k, 18);
    for (n = 0; n < 6; n++) {
        double smooth;
        if (!m->free[n]) continue;
        free = 1;
        smooth = by_impulse(&w, rates[n] - old->b[6 + n], old->smooth[n]);
        now->b[n] = old->b[n] + w.h * old->b[6 + n] +
                    w.h * w.h * ((0.5 - w.beta) * old->smooth[n] + w.beta * smooth);
        now->b[6 + n] = rates[n];
    }
    find_carrier(ms, k, now->b, &now->carrier);
    copy(now->felt, old->felt, 6);
    if (free) {
        for (i = 0; i < 3; i++) {
            now->felt[i] = 0.0;
            for (j = 0; j < 3; j++)
                now->felt[i] += (now->carrier.R[3 * j + i] + old->carrier.R[3 * j + i]) *
                                (now->carrier.v[j] - old->carrier.v[j]) / 2.0 / w.h;
            now->felt[3 + i] = (now->carrier.omega[i] - old->carrier.omega[i]) / w.h;
        }
        seconds_of(&old->carrier, now->felt, second);
        drivers_at(ms, k - 1, &old->carrier, old->b, second, 1, ms->u_old);
        seconds_of(&now->carrier, now->felt, second);
        drivers_at(ms, k, &now->carrier, now->b, second, 1, ms->u);
        for (n = 0; n < m->inertial_count; n++) {
            const double mean = (loads[m->inertial[n]] + old_loads[m->inertial[n]]) / 2.0;
            ms->new_smooth[n] = by_impulse(&w, w.h * mean, ms->inertia_smooth[n]);
            ms->new_inertia[n] = of_smoothed(&w, ms->new_smooth[n], ms->inertia_smooth[n], ms->inertia[n]);
        }
        for (n = 0; n < 6; n++) second[n] = old->rates_known > 1 ? (3.0 * now->felt[n] - old->felt[n]) / 2.0 : now->felt[n];
        seconds_of(&now->carrier, second, now->b + 12);
    }
    drivers_at(ms, k, &now->carrier, now->b, now->b + 12, 0, ms->u);
    for (n = 0; n < m->inertial_count; n++) {
        if (free)
            ms->u[y->paths + m->inertial[n]] = ms->new_inertia[n];
        else
            ms->new_smooth[n] = ms->new_inertia[n] = loads[m->inertial[n]];
    }
    failed = step_boom(ms->state, ms->u, NULL);
    if (failed) return failed;
    z[0] = ms->state->z, z[1] = z[2] = ms->state->v;
    find_whole(ms, k, now->b, &now->carrier, loads, z, &now->whole);
    if (ms->failed) return ms->failed;
    if (isnan(now->cylinder.force)) return PMR_LOST;
    for (n = 0; n < 6; n++) {
        const double force = smoothed(&w, now->whole.forces[n], old->whole.forces[n], old->forces[n]);
        left[n] = now->whole.momenta[n] - old->whole.momenta[n] -
                  w.h * ((1.0 - w.gamma) * old->forces[n] + w.gamma * force);
    }
    for (n = 0; n < 3; n++) middle[n] = (now->b[n] + old->b[n]) / 2.0;
    add_cross(-1.0, middle, left, left + 3);
    copy(now->left, left, 3);
    for (i = 0; i < 3; i++) {
        now->left[3 + i] = 0.0;
        for (j = 0; j < 3; j++)
            now->left[3 + i] += (now->whole.axes[3 * j + i] + old->whole.axes[3 * j + i]) * left[3 + j] / 2.0;
    }
    return PMR_DONE;
}

/* The fastest so far, along and about axes, with that of a motion and its acceleration within a step. */
static void find_fastest(const pmr_machine_run *ms, const double *b, double *fastest)
{
    int n;
    copy(fastest, ms->past.fastest, 2);
    for (n = 0; n < 6; n++) {
        const double rate = fabs(b[6 + n]), change = fabs(b[12 + n]) * ms->state->settings.step;
        fastest[n / 3] = larger(fastest[n / 3], larger(rate, change));
    }
}

/* Derivative of the free directions' impulses by their rates, from what was tried last. */
static int find_machine_slope(pmr_machine_run *ms, int64_t k, const int *which, int count)
{
    const trial at = ms->now;
    double rates[6];
    int n, j;
    for (n = 0; n < count; n++) {
        int failed;
        copy(rates, at.b + 6, 6);
        rates[which[n]] += MACHINE_DIFFERENCE;
        restore_boom(ms);
        failed = try_rates(ms, k, rates);
        if (failed) return failed;
        for (j = 0; j < count; j++)
            ms->past.slope[j * count + n] = (ms->now.left[which[j]] - at.left[which[j]]) / MACHINE_DIFFERENCE;
    }
    ms->past.slope_known = 1;
    restore_boom(ms);
    return try_rates(ms, k, at.b + 6); /* what is taken is what was tried last */
}

/* ---- how the end of a step changes by the rate of a single direction ----

   A second trial tells this answer, a D, and how it drifts from step to step.  In the steps that follow the first trial's
   end x becomes x + D dr, with no second trial, while what the answer is off by leaves it accurate. */

enum { ANSWER_AGE = 20 };
/* What an answer that was just learned may be off by; what it may leave of rates, over the fastest. */
#define ANSWER_FRESH 1e-4
#define ANSWER_LEFT 3e-14

_Static_assert(offsetof(trial, cylinder.emptied) % (PMR_LANES * sizeof(double)) == 0, "registers of a trial");

static size_t filled_up(size_t count) { return (count + 7) / 8 * 8; } /* as `take_room` does */

/* A part of what a step ends with, its place among all numbers of an end, and how many it has; NULL behind the last. */
static double *end_part(pmr_machine_run *ms, int part, size_t *at, size_t *count)
{
    const size_t of_state = ms->state->stepped, of_trial = offsetof(trial, cylinder.emptied) / sizeof(double);
    const pmr_system *y = ms->state->system;
    switch (part) {
    case 0: *at = 0, *count = of_state; return ms->state->mark;
    case 1: *at = of_state, *count = of_trial; return (double *)(void *)&ms->now;
    case 2:
        *at = of_state + of_trial;
        *count = 2 * filled_up(ms->machine->inertial_count) + filled_up(y->drivers);
        return ms->new_inertia;
    default: return NULL;
    }
}

static size_t end_size(const pmr_system *y, const pmr_state *st, const pmr_machine *machine)
{
    return st->stepped + offsetof(trial, cylinder.emptied) / sizeof(double) + 2 * filled_up(machine->inertial_count) +
           filled_up(y->drivers);
}

static void keep_end_tried(pmr_machine_run *ms)
{
    const double *from;
    size_t at, count;
    int part;
    for (part = 0; (from = end_part(ms, part, &at, &count)); part++)
        memcpy(ms->tried + at, from, count * sizeof(double));
}

static int is_taut(const pmr_state *st) { return st->system->hoist && st->hoist[AT_FORCE] > 0.0; }

/* Learn from what a change of the rate did to the end since `keep_end_tried`.  The answer is off by the share by which
   rates of modes were foreseen wrong, over the square of the steps since the last one. */
static void learn_answer(pmr_machine_run *ms, double change)
{
    const size_t rates = (size_t)(ms->state->v - ms->state->mark);
    const double *now;
    const double age = ms->past.answer_age, by_change = 1.0 / change, by_age = ms->past.answers ? 1.0 / age : 0.0;
    double off = 0.0, all = 0.0;
    size_t at, count, n;
    int part;
    for (n = 0; n < (size_t)ms->state->system->modes; n++) {
        const double is = (ms->state->v[n] - ms->tried[rates + n]) * by_change,
                     missed = is - ms->answer[rates + n] - ms->answer_drift[rates + n] * age;
        off += missed * missed, all += is * is;
    }
    for (part = 0; (now = end_part(ms, part, &at, &count)); part++)
        for (n = 0; n < count; n += VL) {
            const vec is = (CONST_LOOSE(now + n) - CV(ms->tried + at + n)) * by_change;
            V(ms->answer_drift + at + n) = (is - CV(ms->answer + at + n)) * by_age;
            V(ms->answer + at + n) = is;
        }
    ms->past.answer_off = all > 0.0 ? sqrt(off / all) / (age * age) : 1.0;
    ms->past.answer_age = 0;
    ms->past.answers++;
    ms->past.answer_taut = is_taut(ms->state);
}

/* How the impulse of direction n changes by its rate. */
static double answered_slope(const pmr_machine_run *ms, int n)
{
    const size_t at = ms->state->stepped + offsetof(trial, left) / sizeof(double) + n;
    return ms->answer[at] + ms->answer_drift[at] * ms->past.answer_age;
}

/* Add to numbers of an end, from number `at` on, what a change of the rate makes of them. */
static void add_answer(const pmr_machine_run *ms, double change, size_t at, size_t count, double *now)
{
    const double drifted = change * ms->past.answer_age, *answer = ms->answer + at, *drift = ms->answer_drift + at;
    size_t n;
    for (n = 0; n < count; n += VL) LOOSE(now + n) += CV(answer + n) * change + CV(drift + n) * drifted;
}

/* Go on from the end that was tried to that of a rate of direction n which differs by a change, `error` of the fastest, if
   the answer is that good, and the law of the cylinder agrees with it; whether this was so: else the end is kept as
   tried. */
static int follow_answer(pmr_machine_run *ms, int64_t k, int n, double change, double error)
{
    const machine_past *past = &ms->past;
    const double age = past->answer_age, off = age > 0.0 ? past->answer_off * age * age : ANSWER_FRESH;
    double springs[6], *now, force = 0.0; /* of a rope */
    size_t at, count;
    int part;
    if (past->answers < 2 || age > ANSWER_AGE || !(error * off <= ANSWER_LEFT) || ms->state->system->pads ||
        is_taut(ms->state) != past->answer_taut)
        return 0;
    now = end_part(ms, 1, &at, &count);
    memcpy(ms->tried + at, now, count * sizeof(double));
    add_answer(ms, change, at, count, now);
    find_springs(ms->machine, k, ms->now.b, springs);
    if (ms->machine->cylinder.kind) push_by_cylinder(ms, k, ms->now.b, springs);
    if (ms->state->system->hoist) {
        const size_t rope = (size_t)(ms->state->hoist + AT_FORCE - ms->state->mark);
        force = ms->state->hoist[AT_FORCE] + change * (ms->answer[rope] + ms->answer_drift[rope] * age);
    }
    if (!(fabs(springs[n] - ms->now.whole.springs[n]) * ms->state->settings.step <=
          MACHINE_ROUND_OFF * fabs(past->slope[0] * change / error)) ||
        (force > 0.0) != past->answer_taut) {
        memcpy(now, ms->tried + at, count * sizeof(double));
        return 0;
    }
    for (part = 0; (now = end_part(ms, part, &at, &count)); part++)
        if (part != 1) add_answer(ms, change, at, count, now);
    return 1;
}

/* Find the motion at the end of step k; PMR_LOST if it is not found. */
static int find_motion_at(pmr_machine_run *ms, int64_t k)
{
    const machine_past *old = &ms->past;
    const double h = ms->state->settings.step;
    double rates[6], change[6], matrix[36], room[6 * 8], fastest[2], smallest = INFINITY;
    double low = -INFINITY, high = INFINITY; /* rates of a single direction between which its impulse changes sign */
    int which[6], count = 0, since = 0, failed, tries, n, j;
    for (n = 0; n < 6; n++)
        if (ms->machine->free[n]) which[count++] = n;
    if (ms->past.rates_known == 3) memmove(ms->past.rates[0], ms->past.rates[1], 12 * sizeof(double));
    if (ms->past.rates_known < 3) ms->past.rates_known++;
    copy(ms->past.rates[ms->past.rates_known - 1], old->b + 6, 6);
    for (n = 0; n < 6; n++)
        rates[n] = old->rates_known < 3 ? old->b[6 + n] + h * old->smooth[n]
                                        : 3.0 * (old->rates[2][n] - old->rates[1][n]) + old->rates[0][n];
    failed = try_rates(ms, k, rates);
    if (failed || !count) return failed;
    ms->past.answer_age++;
    if (count == 1 && old->answers) ms->past.slope[0] = answered_slope(ms, which[0]);
    for (tries = 0; tries < MOST_TRIALS; tries++) {
        double error = 0.0, square = 0.0, left[6];
        if (!ms->past.slope_known || since == PATIENCE) {
            failed = find_machine_slope(ms, k, which, count);
            if (failed) return failed;
            since = 0;
        }
        copy(matrix, old->slope, count * count);
        for (n = 0; n < count; n++) change[n] = -ms->now.left[which[n]];
        if (solve_dense(count, matrix, change, room)) return PMR_LOST;
        find_fastest(ms, ms->now.b, fastest);
        for (n = 0; n < count; n++) {
            error = larger(error, fabs(change[n]) / fastest[which[n] / 3]);
            square += change[n] * change[n];
            left[n] = ms->now.left[which[n]];
        }
        if (error <= MACHINE_ROUND_OFF || (error <= MACHINE_NEAR && error > smallest / 2.0)) return PMR_DONE;
        smallest = error < smallest ? error : smallest;
        since++;
        copy(rates, ms->now.b + 6, 6);
        if (count == 1 && old->slope[0] > 0.0) {
            const double rate = rates[which[0]];
            if (left[0] < 0.0) low = larger(low, rate);
            if (left[0] > 0.0) high = rate < high ? rate : high;
            if (low < high && (rate + change[0] <= low || rate + change[0] >= high))
                change[0] = (low + high) / 2.0 - rate;
            square = change[0] * change[0];
        }
        for (n = 0; n < count; n++) rates[which[n]] += change[n];
        if (count == 1 && follow_answer(ms, k, which[0], change[0], error)) return PMR_DONE;
        if (count == 1 && !tries) keep_end_tried(ms);
        restore_boom(ms);
        failed = try_rates(ms, k, rates);
        if (failed) return failed;
        if (!tries && count == 1 && error > MACHINE_NEAR) learn_answer(ms, change[0]);
        for (n = 0; n < count && error > MACHINE_NEAR; n++) { /* as Broyden has it; less is round-off */
            double missed = ms->now.left[which[n]] - left[n];
            for (j = 0; j < count; j++) missed -= old->slope[n * count + j] * change[j];
            for (j = 0; j < count; j++) ms->past.slope[n * count + j] += missed * change[j] / square;
        }
    }
    return PMR_LOST;
}

/* z'' of the boom's modes where it stands, under what it was stepped to. */
static void accelerate_boom(pmr_machine_run *ms)
{
    accelerate(ms->state, ms->u + ms->state->system->paths, ms->accelerations);
}

/* End step k with what was tried last. */
static int end_machine_step(pmr_machine_run *ms, int64_t k)
{
    const pmr_machine *m = ms->machine;
    const pmr_system *y = ms->state->system;
    machine_past *past = &ms->past;
    const trial *now = &ms->now;
    const weights w = weights_of(ms->state->settings.step, ms->state->settings.rho_inf);
    const double *z[3] = {ms->state->z, ms->state->v, ms->accelerations};
    double axes[9], turned[3], left[6], middle[3], momenta[6], needed[6];
    int held = 0, n;
    if (!all_finite(now->b, 18)) return PMR_NOT_FINITE;
    if (now->cylinder.emptied) return PMR_LOST;
    if (cos(now->b[4]) < MACHINE_UPRIGHT) return PMR_UPRIGHT;
    for (n = 0; n < 6; n++) {
        left[n] = m->free[n] ? now->left[n] : 0.0;
        if (m->free[n])
            past->smooth[n] = by_impulse(&w, now->b[6 + n] - past->b[6 + n], past->smooth[n]);
        else
            held = !m->luffs; /* nobody asks what holds a free luffing angle's frame */
    }
    for (n = 0; n < 6; n++)
        past->forces[n] = smoothed(&w, now->whole.forces[n], past->whole.forces[n], past->forces[n]);
    for (n = 0; n < 6; n++) past->held[n] = 0.0;
    if (held) {
        accelerate_boom(ms);
        find_holding_forces(ms, k, now->b, ms->u + y->paths, z, needed);
        for (n = 0; n < 6; n++) past->held[n] = m->free[n] ? 0.0 : needed[n];
    }
    /* what round-off has left of a step is not carried on into the next one */
    copy(momenta, now->whole.momenta, 6);
    for (n = 0; n < 3; n++) momenta[n] -= left[n];
    if (m->free[3] && m->free[4] && m->free[5]) {
        for (n = 0; n < 9; n++) axes[n] = (now->whole.axes[n] + past->whole.axes[n]) / 2.0;
        solve_three(axes, 1, left + 3, turned);
        for (n = 0; n < 3; n++) {
            momenta[3 + n] -= turned[n];
            middle[n] = (now->b[n] + past->b[n]) / 2.0;
        }
        add_cross(-1.0, middle, left, momenta + 3);
    }
    past->carrier = now->carrier;
    past->whole = now->whole;
    past->cylinder = now->cylinder;
    copy(past->momenta, now->whole.momenta, 6);
    copy(past->whole.momenta, momenta, 6);
    copy(past->b, now->b, 18);
    copy(past->felt, now->felt, 6);
    copy(ms->inertia, ms->new_inertia, m->inertial_count);
    copy(ms->inertia_smooth, ms->new_smooth, m->inertial_count);
    find_fastest(ms, now->b, past->fastest);
    tell_motions(ms, k, now->b);
    store_end(ms);
    return PMR_DONE;
}

/* ---- the interface ---- */

static void lay_out_machine(pmr_machine_run *ms, const pmr_state *st, const pmr_machine *machine, room *r)
{
    const pmr_system *y = st->system;
    pmr_machine_run *taken = take_room(r, 1, sizeof *ms);
    int o;
    if (taken) ms = taken;
#define ROOM(field, count) ms->field = take_room(r, (size_t)(count), sizeof(double))
    ROOM(tried, end_size(y, st, machine));
    if (machine != &y->boom) {
        ROOM(saved, st->stepped);
        ROOM(answer, end_size(y, st, machine));
        ROOM(answer_drift, end_size(y, st, machine));
    }
    ROOM(motions, 3 * y->motions);
    ROOM(inertia, machine->inertial_count);
    ROOM(inertia_smooth, machine->inertial_count);
    ROOM(new_inertia, machine->inertial_count); /* up to `u` a part of a step's end */
    ROOM(new_smooth, machine->inertial_count);
    ROOM(u, y->drivers);
    ROOM(u_old, y->drivers);
    ROOM(accelerations, y->modes);
    ROOM(begun, 2 * y->modes);
    for (o = 0; o < 3; o++) {
        ROOM(tables.C[o], o ? (size_t)y->rows * y->modes : 0); /* the first are those of the state */
        ROOM(tables.H[o], o ? (size_t)y->rows * y->ip : 0);
        ROOM(tables.A[o], (size_t)y->rows * y->mp);
        ROOM(inertial[o], y->ip);
    }
    ROOM(factor, (size_t)y->rows * y->mp);
    ROOM(lambda, 3 * y->mp);
    ROOM(right, y->mp);
    ROOM(product, y->modes);
    ms->paths = take_room(r, (size_t)y->paths, sizeof(moved));
    if (machine == &y->boom) { /* arrays of two steps */
        const size_t n = y->motions;
        ms->own.motions = take_room(r, 6 * n, sizeof(double));
        ms->own.rates = take_room(r, 2 * n, sizeof(double));
        ms->own.base_motion = take_room(r, 36, sizeof(double));
        ms->own.external = take_room(r, 12, sizeof(double));
        ms->own.weight = take_room(r, 2, sizeof(double));
        ms->own.drive = take_room(r, 4, sizeof(double));
    }
    ms->giving = take_room(r, (size_t)y->mp, sizeof(int32_t));
    ms->ranges = take_room(r, 2 * (size_t)(MOST_SECTIONS + 1) * (ROTATING + SECOND + machine->shortened_count), sizeof(int32_t));
#undef ROOM
}

/* Whether a machine can carry the boom, stepped as the state's settings say. */
static int can_carry(const pmr_system *y, const pmr_settings *settings, const pmr_machine *machine)
{
    int n;
    if (!y->motions || machine->sections < 1 || machine->sections > MOST_SECTIONS || y->pushing || settings->energy ||
        settings->levels != 1 || (settings->parts && settings->parts[0] != 1))
        return 0;
    for (n = 0; n < 6; n++)
        if (machine->luffs && machine->free[n] != (n == 4)) return 0;
    return machine->luffs ? y->frame_angles[0] >= 0 && machine->mass == 0.0 : y->frame_angles[2] >= 0;
}

static int machine_run_open(pmr_state *st, const pmr_machine *machine, pmr_machine_run **run)
{
    const pmr_system *y = st->system;
    pmr_machine_run counted = {0};
    room r = {NULL, 0};
    *run = NULL;
    if (!can_carry(y, &st->settings, machine)) return PMR_REFUSED;
    lay_out_machine(&counted, st, machine, &r);
    r.memory = pmr_aligned(r.at);
    if (!r.memory) return PMR_NO_MEMORY;
    memset(r.memory, 0, r.at);
    r.at = 0;
    lay_out_machine(&counted, st, machine, &r);
    *run = (pmr_machine_run *)r.memory;
    (*run)->machine = machine;
    (*run)->state = st;
    find_ranges(*run);
    return PMR_DONE;
}

static int machine_run_holding_forces(pmr_machine_run *ms, const double *b, const double *z, const double *v,
                                      const double *a, double *needed)
{
    const pmr_system *y = ms->state->system;
    double *const of = ms->state->others, *const rates = ms->state->pulled;
    const double *modes[3] = {of, rates, ms->accelerations};
    carrier c;
    find_carrier(ms, 0, b, &c);
    drivers_at(ms, 0, &c, b, b + 12, 0, ms->u);
    if (y->hoist) { /* whose rope pulls where the boom stands */
        const int failed = start(ms->state, PMR_GIVEN, ms->u, NULL, z, v);
        if (failed) return failed;
    }
    copy(of, z, y->modes);
    copy(rates, v, y->modes);
    copy(ms->accelerations, a, y->modes);
    find_holding_forces(ms, 0, b, ms->u + y->paths, modes, needed);
    return ms->failed;
}

static int machine_run_load_cylinder(pmr_machine_run *ms, const double *place, const double *z)
{
    const pmr_actuator *c = &ms->machine->cylinder;
    double b[18] = {0.0}, *nothing = ms->accelerations, needed[6], arm;
    int failed;
    memset(ms->loaded, 0, sizeof ms->loaded);
    if (!c->kind) return PMR_DONE;
    copy(b, place, 6);
    memset(nothing, 0, ms->state->system->modes * sizeof(double));
    failed = machine_run_holding_forces(ms, b, z, nothing, nothing, needed);
    if (failed) return failed;
    (void)length_at(c, ms->machine->level - place[4], &arm);
    load_by_force(c, needed[4] / -arm, ms->loaded);
    return PMR_DONE;
}

/* What holds the machine where it is accelerated by b's second rates, which the boom's follow. */
static int begin_with(pmr_machine_run *ms, const double *b, const double *z, const double *v, double *needed)
{
    const pmr_system *y = ms->state->system;
    const double *modes[3] = {ms->state->z, ms->state->v, ms->accelerations};
    carrier c;
    int failed;
    find_carrier(ms, 0, b, &c);
    drivers_at(ms, 0, &c, b, b + 12, 0, ms->u);
    failed = start(ms->state, PMR_GIVEN, ms->u, NULL, z, v);
    if (failed) return failed;
    accelerate_boom(ms);
    find_holding_forces(ms, 0, b, ms->u + y->paths, modes, needed);
    return ms->failed;
}

static void record_machine(const pmr_machine_run *ms, const pmr_machine_record *record, int64_t row)
{
    record_row(record->motion, row, 18, ms->past.b);
    record_row(record->held, row, 6, ms->past.held);
    record_row(record->springs, row, 6, ms->past.whole.springs);
    record_row(record->momenta, row, 6, ms->past.momenta);
    record_row(record->inertia, row, ms->machine->inertial_count, ms->inertia);
    record_row(record->cylinder, row, PMR_CYLINDER_COLUMNS, &ms->past.cylinder.length);
}

static int machine_run_start(pmr_machine_run *ms, const double *given, const double *z, const double *v,
                         const pmr_machine_record *record)
{
    const pmr_machine *m = ms->machine;
    const pmr_system *y = ms->state->system;
    machine_past *past = &ms->past;
    const double *modes[3] = {ms->state->z, ms->state->v, ms->state->v};
    double b[18], none[6], needed[6], matrix[36], room[6 * 8], second[6], balanced = 0.0;
    int which[6], count = 0, failed, n, j;
    copy(b, given, 18);
    memset(past, 0, sizeof *past);
    memset(ms->answer, 0, end_size(y, ms->state, m) * sizeof(double));
    memset(ms->answer_drift, 0, end_size(y, ms->state, m) * sizeof(double));
    ms->rows_known = 0;
    for (n = 0; n < 6; n++)
        if (m->free[n]) which[count++] = n;
    for (n = 0; n < count; n++) b[12 + which[n]] = 0.0;
    failed = begin_with(ms, b, z, v, none);
    for (n = 0; n < count && !failed; n++) {
        b[12 + which[n]] = 1.0;
        failed = begin_with(ms, b, z, v, needed);
        b[12 + which[n]] = 0.0;
        for (j = 0; j < count; j++) matrix[j * count + n] = needed[which[j]] - none[which[j]];
    }
    if (failed) return failed;
    for (n = 0; n < count; n++) second[n] = -none[which[n]];
    if (count && solve_dense(count, matrix, second, room)) return PMR_LOST;
    for (n = 0; n < count; n++) b[12 + which[n]] = second[n];
    failed = begin_with(ms, b, z, v, needed);
    if (failed) return failed;
    for (n = 0; n < 6; n++) past->held[n] = m->free[n] ? 0.0 : needed[n];
    copy(past->b, b, 18);
    copy(past->smooth, b + 12, 6);
    find_carrier(ms, 0, b, &past->carrier);
    feel(&past->carrier, b + 12, past->felt);
    for (n = 0; n < m->inertial_count; n++)
        ms->inertia[n] = ms->inertia_smooth[n] = ms->u[y->paths + m->inertial[n]];
    find_whole(ms, 0, b, &past->carrier, ms->u + y->paths, modes, &past->whole);
    past->cylinder = ms->now.cylinder;
    copy(past->forces, past->whole.forces, 6);
    copy(past->momenta, past->whole.momenta, 6);
    for (n = 0; n < 6; n++) balanced = larger(balanced, fabs(past->whole.springs[n]) / (m->boom_mass + m->mass));
    balanced = ms->state->settings.step * (balanced + m->largest_weight);
    past->fastest[0] = past->fastest[1] = larger(balanced, 1e-100); /* whose square is a number */
    find_fastest(ms, b, past->fastest);
    tell_motions(ms, 0, b);
    store_end(ms);
    record_machine(ms, record, 0);
    return PMR_DONE;
}

static int machine_run_advance(pmr_machine_run *ms, int64_t first, int64_t count, const pmr_machine_record *record,
                           int64_t *taken)
{
    for (*taken = 0; *taken < count; ++*taken) {
        const machine_past past = ms->past;
        int failed = find_motion_at(ms, first + *taken);
        if (!failed) failed = end_machine_step(ms, first + *taken);
        if (failed) {
            ms->past = past;
            ms->past.answers = 0; /* the failed step may have learned another answer */
            ms->rows_known = 0;
            restore_boom(ms);
            return failed;
        }
        record_machine(ms, record, *taken);
    }
    return PMR_DONE;
}
