/* Many steps in a row, and what is recorded of them. */

static void record_row(double *to, int64_t row, int count, const double *from)
{
    if (to) copy(to + (size_t)row * count, from, count);
}

static void record_step(pmr_state *st, const pmr_record *record, int64_t row)
{
    const pmr_system *y = st->system;
    record_row(record->z, row, y->modes, st->z);
    record_row(record->v, row, y->modes, st->v);
    record_row(record->multipliers, row, y->contacts, st->lambda);
    record_row(record->impulses, row, y->contacts, st->impulse);
    record_row(record->peaks, row, y->contacts, st->progress.parts > 1 ? st->peak : st->lambda);
    record_row(record->energy, row, 2, st->energy);
    record_row(record->friction, row, y->pads, st->friction);
    record_row(record->drivers, row, y->drivers, st->u);
    if (record->hoist && y->hoist) show_hoist(st, record->hoist + row * PMR_HOIST_OUTPUTS);
    if (record->parts) record->parts[row] = st->progress.parts;
    if (record->outputs) outputs(st, record->outputs + (size_t)row * y->outputs, NULL);
}

/* The level on which a step is made in `count` parts; less than 0 if there is none. */
static int level_of(const pmr_state *st, int32_t count)
{
    int k;
    for (k = 0; k < st->settings.levels; k++)
        if (st->settings.parts[k] == count) return k;
    return -1;
}

static int all_finite(const double *values, int count)
{
    vec sums = {0.0}; /* zero times what is not finite is no number */
    double sum;
    int n;
    for (n = 0; n + VL <= count; n += VL) sums += CONST_LOOSE(values + n) * 0.0;
    for (sum = sum_of(sums); n < count; n++) sum += 0.0 * values[n];
    return sum == 0.0;
}

static int is_finite(const pmr_state *st)
{
    return all_finite(st->z, st->system->modes) && all_finite(st->v, st->system->modes);
}

static int make_steps(pmr_state *st, pmr_course *course, const double *samples, int64_t count, int64_t every,
                      const int32_t *parts, const pmr_record *record, int64_t *taken)
{
    int64_t number, row = 0;
    int failed = PMR_DONE;
    if (every < 1) every = 1;
    for (number = 0; number < count; number++) {
        int level = -1;
        if (parts && (level = level_of(st, parts[number])) < 0) {
            failed = PMR_REFUSED;
            break;
        }
        course->step = st->progress.step;
        if (samples) course->samples = samples + (size_t)number * course->per * st->system->drivers;
        failed = make_step(st, level, course);
        if (failed) break;
        if ((number + 1) % every == 0) record_step(st, record, row++);
    }
    *taken = number;
    if (number && !is_finite(st)) failed = PMR_NOT_FINITE;
    return failed;
}

static int advance_signals(pmr_state *st, const pmr_signals *signals, int64_t count, int64_t every,
                           const int32_t *parts, const pmr_record *record, int64_t *taken)
{
    pmr_course course = {.signals = signals, .h = st->settings.step, .ends = record->ends};
    *taken = 0;
    if (st->run || signals->drivers != (st->system->motions ? st->system->motions : st->system->drivers)) return PMR_REFUSED;
    return make_steps(st, &course, NULL, count, every, parts, record, taken);
}

static int advance_sampled(pmr_state *st, const double *u, int per, int64_t count, int64_t every, const int32_t *parts,
                           const pmr_record *record, int64_t *taken, int *needed)
{
    pmr_course course = {.samples = u, .per = per, .h = st->settings.step};
    int failed;
    *taken = 0;
    *needed = 0;
    if (per < 1 || st->system->computed) return PMR_REFUSED;
    failed = make_steps(st, &course, u, count, every, parts, record, taken);
    if (failed != COARSE) return failed;
    *needed = st->settings.parts[st->progress.level];
    return PMR_DONE;
}

/* One step along a course, of which the step's length and number are still missing. */
static int make_one_step(pmr_state *st, pmr_course course)
{
    int failed;
    course.h = st->settings.step;
    course.step = st->progress.step;
    failed = make_step(st, -1, &course);
    if (failed || is_finite(st)) return failed;
    st->progress.step = course.step;
    return PMR_NOT_FINITE;
}

/* A step of the boom alone, as those of a machine have it. */
static int step_boom(pmr_state *st, const double *u, const double *rates)
{
    if (!all_finite(u, st->system->drivers)) return PMR_REFUSED;
    copy(st->u_begun, st->u, st->system->drivers);
    return make_one_step(st, (pmr_course){.begun = st->u_begun, .ended = u, .rates = rates});
}

static int step_to(pmr_state *st, const double *u, const double *rates)
{
    return st->system->computed ? PMR_REFUSED : step_boom(st, u, rates);
}

static int start_computed(pmr_state *st, int kind, const double *motions, const double *z, const double *v);
static int step_luffing(pmr_state *st, const double *motions);

static int step_led(pmr_state *st, const double *led, double since)
{
    const pmr_system *y = st->system;
    const int n = y->motions ? y->motions : y->drivers;
    int failed, k;
    if (!all_finite(led, 4 * n)) return PMR_REFUSED;
    if (st->run) {
        pmr_lead_on(led, n, since + st->settings.step, 3, st->motions_next);
        return step_luffing(st, st->motions_next);
    }
    failed = make_one_step(st, (pmr_course){.led = led, .since = since});
    if (failed || !y->motions || y->computed) return failed;
    pmr_lead_on(led, n, since + st->settings.step, 3, st->motions);
    for (k = 0; k < n; k++) st->motions[3 * n + k] = 3.0;
    return PMR_DONE;
}

/* Motions (4, n) from rows (3, n) and how many of them count. */
static void take_motions(const pmr_system *y, const double *motions, const int32_t *rows, double *to)
{
    int k;
    copy(to, motions, 3 * y->motions);
    for (k = 0; k < y->motions; k++) to[3 * y->motions + k] = rows ? rows[k] : 3;
}

static int start_in_frame(pmr_state *st, int kind, const double *motions, const int32_t *rows, const double *z,
                          const double *v)
{
    const pmr_system *y = st->system;
    int failed = pmr_frame_drivers(y, motions, st->u_next, st->quantities), k;
    if (failed) return failed;
    if (y->computed) return start_computed(st, kind, motions, z, v);
    for (k = 0; k < y->paths; k++) /* of those whose rates count */
        st->s_rates[k] = !rows || rows[y->frame_paths[k]] > 1 ? motions[y->motions + y->frame_paths[k]] : 0.0;
    failed = start(st, kind, st->u_next, st->s_rates, z, v);
    if (!failed) take_motions(y, motions, rows, st->motions);
    return failed;
}

static int step_in_frame(pmr_state *st, const double *motions, const int32_t *rows)
{
    const pmr_system *y = st->system;
    int failed;
    if (!y->motions || !all_finite(motions, 3 * y->motions)) return PMR_REFUSED;
    if (st->run) return step_luffing(st, motions);
    take_motions(y, motions, rows, st->motions_next);
    failed = make_one_step(st, (pmr_course){.motions = st->motions_next});
    if (!failed && !y->computed) copy(st->motions, st->motions_next, 4 * y->motions);
    return failed;
}
