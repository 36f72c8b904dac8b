/* Steps in 1, 2, 4, ... equal parts, as few as keep the forces of contacts that only push to the tolerance.

   A part of length h errs in the modes, in leading order, by

       e = h^2 / 12 (z''_{n+1} - z''_n) - 5 h^2 / 12 sum C^T d lambda

   with the sum over contacts that have opened or closed in it, at a time that nobody knows: half their impulse.  In
   the forces of those that are closed this makes A^-1 C e.  The first term is that of the trapezoidal rule
   (Zienkiewicz, Xie 1991).  A step that misses too much is taken back and made in more parts; half the length misses
   an eighth, and may miss a half. */

#define SPARE 0.125

/* z'' of the modes in the present state under loads f. */
static void accelerate(pmr_state *st, const double *f, double *a)
{
    const pmr_system *y = st->system;
    int k, n, l;
    f = with_pulls(st, f);
    for (n = 0; n < y->modes; n += VL) {
        vec sum = CV(y->omega2 + n) * CV(st->z + n);
        if (!y->coupled) sum += CV(y->damping + n) * CV(st->v + n);
        const int32_t *touching = y->mode_inputs + 2 * (n / PMR_LANES);
        for (l = touching[0]; l < touching[1]; l++) sum -= CV(y->B + l * y->modes + n) * f[l];
        V(a + n) = -sum;
    }
    if (y->coupled)
        for (k = 0; k < y->modes; k++)
            for (n = 0; n < y->modes; n += VL) V(a + n) -= CV(y->damping + (size_t)k * y->modes + n) * st->v[k];
    if (y->registers)
        for (n = 0; n < y->modes; n += VL) V(a + n) += CV(st->w + n);
    subtract_rows(st, 0, y->rows, a);
}

/* Begin with parts of another length where the last step ended; the prediction stays where it is the old length after
   all. */
static int begin_level(pmr_state *st, int level, const double *u)
{
    const pmr_system *y = st->system;
    const pmr_scheme *c = st->scheme + level;
    const double *f = u + y->paths;
    int failed;
    st->progress.active = level;
    st->placed = 0;
    failed = place(st, c, u);
    if (failed) return failed;
    if (y->registers || y->pads) begin_terms(st, f + y->inputs);
    accelerate(st, f, st->accelerated);
    if (level != st->progress.came) predict(st, c);
    if (y->quasi_static) predict_quasi_static(st, c, st->z);
    if (st->settings.energy) {
        load_bodies(st, f);
        find_load_energy(st);
        keep_end(st);
    }
    return PMR_DONE;
}

/* What the last part misses of the closed contacts' forces at most, over what it may miss. */
static double missed(pmr_state *st, const pmr_scheme *c, const double *f)
{
    const pmr_system *y = st->system;
    double *old = st->accelerated, *now = st->acceleration, h = c->h, most = 0.0, largest = st->progress.largest,
           allowed;
    int k, n;
    if (y->quasi_static) accelerate(st, f, now); /* in the step such modes have none */
    for (n = 0; n < y->modes; n += VL) V(old + n) = (CV(now + n) - CV(old + n)) * (h * h / 12.0);
    for (k = 0; k < y->contacts; k++) {
        largest = larger(largest, st->lambda[k]);
        if (st->closed[k] != st->before_closed[k]) {
            const double impulse = (st->lambda[k] - st->before_lambda[k]) * (5.0 * h * h / 12.0);
            for (n = y->row_modes[2 * k]; n < y->row_modes[2 * k + 1]; n += VL)
                V(old + n) -= CV(st->C + k * y->modes + n) * impulse;
        }
    }
    for (n = 0; n < st->factored; n++) {
        k = st->numbers[n];
        st->entries[n] = dot(st->C + k * y->modes, old, y->row_modes[2 * k], y->row_modes[2 * k + 1]);
    }
    solve(st->factor, st->factored, y->mp, st->entries);
    for (n = 0; n < st->factored; n++) most = larger(most, fabs(st->entries[n]));
    for (n = 0; n < y->modes; n += VL) V(old + n) = CV(now + n);
    st->progress.largest = largest;
    allowed = st->settings.tolerance * largest *
              (h * st->settings.contact_omega < 1.0 ? h * st->settings.contact_omega : 1.0);
    return most > 0.0 ? most / allowed : 0.0;
}

/* Drivers of a step at its parts: samples, or something that tells them. */
struct pmr_course {
    const double *samples; /* (per + 1, N), or NULL */
    int per;
    const pmr_signals *signals; /* at t = (step * parts + part) h / parts, or NULL: lines or cubics between two ends */
    int64_t step;
    double h;
    const double *begun, *ended, *rates;
    const double *motions; /* (4, n) at the end, where a frame is driven from outside */
    const double *led;     /* (4, .): drivers or motions and their rates, `since` before the step begins */
    double since;
    double *ends; /* (parts, 3 + N) or NULL: a free extension with its rates, and drivers, where parts end (`pmr_record`) */
};

/* A number and its first three rates where a step of h begins, (4): a cubic by rates at both ends, or a straight line
   where `rates` is 0. */
static void join_ends(double begun, double ended, double h, int rates, double first, double last, double led[4])
{
    const double mean = (ended - begun) / h;
    led[0] = begun;
    led[1] = rates ? first : mean;
    led[2] = rates ? (6.0 * mean - 4.0 * first - 2.0 * last) / h : 0.0;
    led[3] = rates ? 6.0 * (first + last - 2.0 * mean) / (h * h) : 0.0;
}

/* Motions (3, n) of a frame at a time t after the step began: straight lines, cubics by rates at both ends, or by
   second rates, as far as these count. */
static void lead_motions(const pmr_state *st, const double *ended, double t, double *now)
{
    const int n = st->system->motions;
    const double h = st->settings.step, *begun = st->motions;
    double led[4], at[3];
    int k, o;
    for (k = 0; k < n; k++) {
        const double count = begun[3 * n + k] < ended[3 * n + k] ? begun[3 * n + k] : ended[3 * n + k];
        join_ends(begun[k], ended[k], h, count >= 2.0, begun[n + k], ended[n + k], led);
        if (count >= 3.0) {
            led[2] = begun[2 * n + k];
            led[3] = (ended[2 * n + k] - led[2]) / h;
            led[1] = (ended[k] - begun[k]) / h - h / 2.0 * led[2] - h * h / 6.0 * led[3];
        }
        pmr_lead_on(led, 1, t, 3, at);
        for (o = 0; o < 3; o++) now[o * n + k] = at[o];
    }
}

/* Motions of a frame at t by signals: kinks of paths are spread over a step. */
static void follow_motions(const pmr_state *st, const pmr_signals *signals, double t, double *now)
{
    const pmr_system *y = st->system;
    int k;
    pmr_signals_at(signals, t, now, now + y->motions);
    for (k = 0; k < y->paths; k++)
        if (y->frame_paths[k] != y->frame_angles[0]) /* the angle that a luffing cylinder turns with has no kinks */
            now[2 * y->motions + y->frame_paths[k]] =
                pmr_signals_spread(signals, y->frame_paths[k], t, st->settings.step);
}

/* Motions (3, n) of a frame at a part of a step. */
static const double *course_motions(pmr_state *st, const pmr_course *course, int part, int parts)
{
    if (course->signals)
        follow_motions(st, course->signals, (double)(course->step * parts + part) * (course->h / parts),
                       st->motions_now);
    else if (course->led)
        pmr_lead_on(course->led, st->system->motions, course->since + course->h * part / parts, 3, st->motions_now);
    else if (part == 0 || part == parts)
        return part ? course->motions : st->motions;
    else
        lead_motions(st, course->motions, course->h * part / parts, st->motions_now);
    return st->motions_now;
}

static void follow_course(const pmr_course *course, int drivers, int part, int parts, double *u)
{
    const double share = (double)part / parts, h = course->h, t = h * share;
    int n;
    if (course->signals) {
        pmr_signals_at(course->signals, (double)(course->step * parts + part) * (h / parts), u, NULL);
        return;
    }
    for (n = 0; n < drivers; n++) {
        const double *rates = course->rates;
        double led[4];
        join_ends(course->begun[n], course->ended[n], h, rates != NULL, rates ? rates[n] : 0.0,
                  rates ? rates[drivers + n] : 0.0, led);
        pmr_lead_on(led, 1, t, 1, u + n);
    }
}

static const double *course_at(pmr_state *st, const pmr_course *course, int part, int parts)
{
    const pmr_system *y = st->system;
    if (course->samples) /* a division takes as long as ten products */
        return course->samples + (size_t)part * (parts == 1 ? course->per : course->per / parts) * y->drivers;
    if (y->motions && (course->led || course->motions || course->signals)) {
        const double *now = course_motions(st, course, part, parts);
        if (y->extension.sections) now = extended_motions(st, now);
        pmr_frame_drivers(y, now, st->u_next, st->quantities);
    } else if (course->led) {
        pmr_lead_on(course->led, y->drivers, course->since + course->h * part / parts, 1, st->u_next);
    } else if (!course->signals && (part == 0 || part == parts)) {
        return part ? course->ended : course->begun;
    } else {
        follow_course(course, y->drivers, part, parts, st->u_next);
    }
    return st->u_next;
}

/* Whether a part that fails has changed what it began with. */
static int is_iterated(const pmr_system *y)
{
    return y->pushing || y->registers || y->pads || y->hoist || y->extension.sections;
}

/* The parts of a step on a level; `*off` is what one of them misses over what it may. */
static int make_parts(pmr_state *st, int level, int judged, const pmr_course *course, double *off)
{
    const pmr_system *y = st->system;
    const pmr_scheme *c = st->scheme + level;
    const int count = st->settings.parts[level];
    int part, failed, k;
    if (level != st->progress.active) {
        failed = begin_level(st, level, course_at(st, course, 0, count));
        if (failed) return failed;
    }
    *off = 0.0;
    for (part = 1; part <= count; part++) {
        const double *u;
        if (judged)
            for (k = 0; k < y->contacts; k++) {
                st->before_closed[k] = st->closed[k];
                st->before_lambda[k] = st->lambda[k];
            }
        if (y->extension.sections) {
            failed = make_extended_part(st, c, course, part, count);
            u = st->u_next;
        } else {
            u = course_at(st, course, part, count);
            failed = make_part(st, c, u);
        }
        if (failed) return failed;
        if (count > 1)
            for (k = 0; k < y->contacts; k++)
                st->peak[k] = part == 1 ? st->lambda[k] : larger(st->peak[k], st->lambda[k]);
        if (judged) *off = larger(*off, missed(st, c, u + y->paths));
        if (part == count) copy(st->u, u, y->drivers), show_pulls(st);
    }
    return PMR_DONE;
}

static void take_back(pmr_state *st)
{
    memcpy(st->mark, st->began, st->marked * sizeof(double));
    st->progress.active = -1;
}

/* Where the step that failed began. */
static int stop(pmr_state *st, int failed)
{
    const pmr_system *y = st->system;
    const int trouble = st->trouble;
    if (is_iterated(y)) memcpy(st->mark, st->began, st->stepped * sizeof(double));
    st->progress.active = st->progress.came = -1;
    st->placed = 0;
    stand(st);
    st->trouble = trouble;
    return failed;
}

/* Returned where a step needs more parts than its course has samples of; the level is the one it needs. */
enum { COARSE = -1 };

/* A step that is one part, of a system in which nothing is iterated or taken back: small bodies feel each branch. */
static int make_whole_step(pmr_state *st, const pmr_course *course)
{
    const double *u = course_at(st, course, 1, 1);
    const int failed = make_part(st, st->scheme, u);
    if (failed) return stop(st, failed);
    copy(st->u, u, st->system->drivers);
    st->progress.step++;
    return PMR_DONE;
}

/* One step; `level` less than 0: as the forces ask for. */
static int make_step(pmr_state *st, int given_level, const pmr_course *course)
{
    const pmr_system *y = st->system;
    const int last = st->settings.levels - 1, judged = given_level < 0 && last > 0 && st->settings.contact_omega > 0.0;
    int level = given_level >= 0 ? given_level : st->progress.level, failed = PMR_DONE;
    double off = 0.0;
    if (last == 0 && !is_iterated(y) && st->settings.parts[0] == 1 && st->progress.active == 0)
        return make_whole_step(st, course);
    if (y->pushing)
        for (int n = 0; n < y->mp; n += VL) V(st->impulse + n) = (vec){0.0};
    if (!judged)
        st->progress.came = -1;
    else if (st->progress.active >= 0)
        st->progress.came = st->progress.active;
    if (is_iterated(y) && !st->run) memcpy(st->began, st->mark, st->stepped * sizeof(double));
    for (;;) {
        if (course->samples && st->settings.parts[level] > 1 && course->per % st->settings.parts[level]) {
            st->progress.level = level;
            return COARSE;
        }
        failed = make_parts(st, level, judged, course, &off);
        if (failed || !judged || off <= 1.0 || level == last) break;
        take_back(st);
        while (off > 1.0 && level < last) {
            level++;
            off /= 4.0;
        }
    }
    if (failed) return stop(st, failed);
    if (judged)
        st->progress.level = off < SPARE && level > 0 ? level - 1 : level;
    else if (given_level >= 0)
        st->progress.level = given_level;
    st->progress.parts = st->settings.parts[level];
    st->progress.step++;
    return PMR_DONE;
}
