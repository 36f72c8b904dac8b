/* A free luffing angle as a part of a system: steps of its boom are those of a machine without mass that is free to pitch
   alone (machine.c), driven by motions of the frame one by one.  The state has what its next step depends on. */

#define STROKE_ROUND_OFF 1e-12

static void lay_out_luffing(const pmr_system *y, pmr_state *st, room *r)
{
    pmr_machine_run *ms = r->memory ? (pmr_machine_run *)(r->memory + r->at) : NULL, counted = {0};
    pmr_machine steps;
    lay_out_machine(ms ? ms : &counted, st, &y->boom, r);
    if (!ms) return;
    steps = ms->own;
    ms->own = y->boom;
    ms->own.motions = steps.motions, ms->own.rates = steps.rates, ms->own.base_motion = steps.base_motion;
    ms->own.external = steps.external, ms->own.weight = steps.weight, ms->own.drive = steps.drive;
    ms->saved = st->began; /* so that trials need not save it again */
    ms->answer = st->answer, ms->answer_drift = st->answer_drift;
    ms->machine = &ms->own;
    ms->state = st;
    find_ranges(ms);
    st->run = ms;
}

/* Put what a step depends on and outputs into the state. */
static void store_luffing(pmr_machine_run *ms)
{
    pmr_state *st = ms->state;
    const int count = ms->machine->inertial_count;
    double *inertia = st->computed_past + (sizeof(machine_past) + 7) / sizeof(double);
    memcpy(st->computed_past, &ms->past, sizeof ms->past);
    copy(inertia, ms->inertia, count);
    copy(inertia + count, ms->inertia_smooth, count);
    st->computed[0] = ms->machine->level - ms->past.b[4];
    st->computed[1] = -ms->past.b[10];
    copy(st->computed + 2, &ms->past.cylinder.length, st->system->computed - 2);
}

static void recall_luffing(pmr_machine_run *ms)
{
    const int count = ms->machine->inertial_count;
    const double *inertia = ms->state->computed_past + (sizeof(machine_past) + 7) / sizeof(double);
    memcpy(&ms->past, ms->state->computed_past, sizeof ms->past);
    copy(ms->inertia, inertia, count);
    copy(ms->inertia_smooth, inertia + count, count);
    save_boom(ms);
}

/* Motions (3, n) of a step, by its row, in the machine's arrays. */
static void take_row(pmr_machine_run *ms, int row, const double *motions)
{
    const pmr_system *y = ms->state->system;
    const int n = y->motions, slewing = y->frame_angles[1];
    double *base = (double *)ms->own.base_motion + 18 * row, *drive = (double *)ms->own.drive + 2 * row;
    int j;
    copy((double *)ms->own.motions + 3 * n * row, motions, 3 * n);
    copy((double *)ms->own.rates + n * row, motions + n, n);
    for (j = 0; j < 3 && slewing >= 0; j++) base[6 * j + 5] = motions[j * n + slewing];
    ((double *)ms->own.weight)[row] = y->luffing_gravity < 0 ? 0.0 : motions[y->luffing_gravity];
    for (j = 0; j < 2; j++) drive[j] = y->luffing_drive < 0 ? 0.0 : motions[j * n + y->luffing_drive];
}

static int start_luffing(pmr_state *st, int kind, const double *motions, const double *z, const double *v)
{
    static const pmr_machine_record none;
    const pmr_system *y = st->system;
    pmr_machine_run *ms = st->run;
    const int n = y->motions;
    const pmr_actuator *c = &ms->machine->cylinder;
    double b[18] = {0.0}, *begun = ms->begun, *rates = begun + y->modes, arm;
    const double length = length_at(c, motions[y->frame_angles[0]], &arm);
    int j, k, failed;
    if (c->kind && fabs(length - clipped(length, c->stroke)) > STROKE_ROUND_OFF * length) return PMR_STROKE;
    take_row(ms, 0, motions);
    take_row(ms, 1, motions);
    ms->own.largest_weight = fabs(ms->own.weight[0]);
    copy(b, ms->own.base_motion, 18);
    for (j = 0; j < 2; j++) b[6 * j + 4] = (j ? 0.0 : ms->own.level) - motions[j * n + y->frame_angles[0]];
    copy(st->motions_next, motions, 3 * n);
    for (j = 1; j < 3; j++) st->motions_next[j * n + y->frame_angles[0]] = 0.0; /* an equilibrium is at rest */
    failed = pmr_frame_drivers(y, st->motions_next, st->u_next, st->quantities);
    if (failed) return failed;
    for (k = 0; k < y->paths; k++) st->s_rates[k] = motions[n + y->frame_paths[k]];
    failed = start(st, kind, st->u_next, st->s_rates, z, v);
    if (failed) return failed;
    copy(begun, st->z, y->modes);
    copy(rates, st->v, y->modes);
    failed = machine_run_load_cylinder(ms, b, begun);
    return failed ? failed : machine_run_start(ms, b, begun, rates, &none);
}

static int step_luffing(pmr_state *st, const double *motions)
{
    static const pmr_machine_record none;
    pmr_machine_run *ms = st->run;
    int64_t taken;
    int failed;
    if (!all_finite(motions, 3 * st->system->motions)) return PMR_REFUSED;
    recall_luffing(ms);
    take_row(ms, 0, st->motions);
    take_row(ms, 1, motions);
    failed = machine_run_advance(ms, 1, 1, &none, &taken);
    if (failed) forget_answer(st);
    return failed;
}
