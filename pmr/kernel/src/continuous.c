/* Values in continuous time, and how they change along a seed: what an ordinary differential equation has to know.

       F lambda = C z + H f - g - c,       z'' = B f + w - D z' - Omega^2 z - C^T lambda

   with lambda of the closed contacts that give way; along a seed, with derivatives C_s, H_s, F_s by the paths,

       F d lambda = C dz + H df + sum over paths of ds (C_s z + H_s f - F_s lambda). */

/* Share of their sizes by which a given position and given rates may move a rigid contact: steps leave O(h^2) of
   rates. */
#define MOVED 1e-6
#define RATES_MOVED 1e-2

/* That of the closed contacts that give way, where the rows stand without a step. */
static problem giving_problem(pmr_state *st, const double *excess, double *lambda)
{
    problem c = problem_of(st, excess, lambda, st->before_closed);
    int k;
    for (k = 0; k < c.rows; k++) c.closed[k] = st->closed[k] != 0.0 && !is_rigid(st, k);
    return c;
}

/* x of F x = x among these contacts; zero at the others. */
static int solve_giving(pmr_state *st, double *x)
{
    problem c = giving_problem(st, x, x);
    const int failed = solve_closed(&c);
    if (failed) st->trouble = c.trouble;
    return failed;
}

/* Rows and loads under `at`, with all that has to be known of a state at z and v but its multipliers. */
static int stand_under(pmr_state *st, const double *at)
{
    const pmr_system *y = st->system;
    int failed;
    if (y->motions)
        pmr_frame_drivers(y, at, st->u, st->quantities);
    else
        copy(st->u, at, y->drivers);
    if (!all_finite(st->u, y->drivers)) return PMR_REFUSED;
    show_pulls(st);
    st->placed = 0;
    st->moved = 1;
    failed = place(st, st->still, st->u); /* F may be singular */
    if (failed && failed != PMR_DEPENDENT) return failed;
    load_bodies(st, st->u + y->paths);
    copy(st->z_free, st->z, y->modes);
    if (y->registers) {
        combine_terms(st, st->u + y->paths + y->inputs);
        find_terms(st, st->z, st->v, st->w);
    }
    return PMR_DONE;
}

/* Multipliers from the position, of rigid contacts those of the last step. */
static int find_position_forces(pmr_state *st, int hold, int32_t *closed)
{
    const pmr_system *y = st->system;
    double *old = st->before_lambda, *x = st->motion;
    int failed, k, j;
    copy(old, st->lambda, y->contacts);
    if (y->pads)
        for (k = 0; k < y->contacts; k++) {
            st->pushed[k] -= st->gap[k];
            for (j = y->contacts; j < y->rows; j++) st->pushed[k] -= st->A[j * y->mp + k] * st->lambda[j];
        }
    if (hold || !y->pushing) {
        for (k = 0; k < y->contacts; k++) {
            st->closed[k] = !hold || closed[k] != 0;
            x[k] = dot(st->C + k * y->modes, st->z, 0, y->modes) + st->pushed[k] - y->clearance[k];
        }
        failed = solve_giving(st, x);
        copy(st->lambda, x, y->contacts);
    } else {
        failed = find_giving(st, NULL); /* what it leaves out is for contacts that hold both ways */
    }
    if (failed) return failed;
    for (k = 0; k < y->contacts; k++) {
        if (is_rigid(st, k)) st->lambda[k] = old[k];
        if (closed) closed[k] = st->closed[k] != 0.0;
    }
    return PMR_DONE;
}

static void copy_values(pmr_state *st, const pmr_values *to, const double *all, const double *accelerations)
{
    const pmr_system *y = st->system;
    if (to->accelerations) copy(to->accelerations, accelerations, y->modes);
    if (to->outputs) copy(to->outputs, all, y->outputs);
    if (to->further) copy(to->further, all + y->op, y->reactions);
    if (to->forces) copy(to->forces, all + y->op + y->hp, y->forces);
}

/* How all of it changes along a seed. */
static int find_changes(pmr_state *st, const double *at, const double *seed_at, const double *dz, const double *dv,
                        const pmr_values *to)
{
    const pmr_system *y = st->system;
    const int r = y->modes;
    const double *amplitudes = st->u + y->paths + y->inputs, *of_terms;
    double *room = st->seeds, *du = room + 10 * (size_t)r, *all = st->changes, *reactions = all + y->op;
    seed d = {.z = room,
              .v = room + r,
              .forces = room + 2 * r,
              .w = room + 3 * r,
              .lambda = st->motion,
              .sums = du + y->drivers,
              .u = du};
    int k, n, failed;
    d.free = d.z;
    copy(d.z, dz, r);
    copy(d.v, dv, r);
    if (y->motions)
        pmr_frame_along(y, at, seed_at, st->u_next, du, st->quantities);
    else
        copy(du, seed_at, y->drivers);
    of_terms = du + y->paths + y->inputs;
    find_slopes(st, st->still);
    for (k = 0; k < y->mp; k++) d.lambda[k] = 0.0;
    for (k = 0; k < y->joints; k++) d.sums[k] = 0.0; /* friction stays as it is */
    for (k = 0; k < y->contacts; k++) st->excess[k] = seed_motion(st, &d, k);
    copy(d.lambda, st->excess, y->contacts);
    failed = solve_giving(st, d.lambda);
    if (failed) return failed;
    for (n = 0; n < r; n++) d.forces[n] = 0.0;
    if (y->registers) {
        amplitude_forces(st, of_terms, d.w);
        combine_terms(st, amplitudes);
        find_terms(st, d.z, d.v, d.forces);
        for (n = 0; n < r; n++) d.forces[n] += d.w[n];
    }
    add_seed_loads(y, &d, d.forces);
    subtract_seed_rows(st, &d, d.forces);
    for (n = 0; n < r; n++) {
        d.forces[n] -= y->omega2[n] * dz[n];
        if (!y->coupled) d.forces[n] -= y->damping[n] * dv[n];
        for (k = 0; y->coupled && k < r; k++) d.forces[n] -= y->damping[(size_t)k * r + n] * dv[k];
    }
    find_outputs(st, y->observed, 0, y->op, d.z, du + y->paths, d.lambda, du, all);
    find_outputs(st, y->observed + 1, 0, y->hp, d.z, du + y->paths, d.lambda, du, reactions);
    add_supports(y, d.v, amplitudes, d.z, d.v, reactions);
    add_supports(y, NULL, of_terms, st->z, st->v, reactions);
    forces_of(st, d.lambda, NULL, reactions + y->hp);
    copy_values(st, to, all, d.forces);
    copy(st->shown, st->values + y->op, y->reactions);
    if (!to->further || !y->motions) return PMR_DONE;
    return pmr_frame_outputs(y, at, seed_at, st->values, all, st->shown, to->further);
}

static int evaluate_along(pmr_state *st, const double *at, const double *seed_at, const double *dz, const double *dv,
                          int hold, const pmr_values *to)
{
    const pmr_system *y = st->system;
    const pmr_progress progress = st->progress;
    int failed;
    if (seed_at && (y->hoist || y->computed)) return PMR_REFUSED;
    if (y->computed) at = computed_motions(st, at);
    memcpy(st->began, st->mark, st->saved * sizeof(double));
    failed = hold && !to->closed ? PMR_REFUSED : stand_under(st, at);
    if (!failed) failed = find_position_forces(st, hold, to->closed);
    if (!failed) {
        find_all(st, 1, st->values);
        if (seed_at) {
            failed = find_changes(st, at, seed_at, dz, dv, to);
        } else {
            accelerate(st, st->u + y->paths, st->acceleration);
            copy_values(st, to, st->values, st->acceleration);
            if (to->further && y->motions)
                failed = pmr_frame_outputs(y, at, NULL, st->values, NULL, to->further, NULL);
            if (to->further) show_behind(st, to->further + y->reactions + 3 * y->has_tip + y->has_cylinder + y->ground);
        }
    }
    return return_to(st, &progress, failed);
}

static int check_start(pmr_state *st, const double *at, const double *rates, const double *z, const double *v,
                       char *why)
{
    const pmr_system *y = st->system;
    const pmr_progress progress = st->progress;
    const char *wrong = NULL;
    int failed, k, n, p;
    memcpy(st->began, st->mark, st->saved * sizeof(double));
    failed = stand_under(st, at);
    if (failed == PMR_REFUSED) wrong = "start as given: what drives the system is not finite";
    if (!failed) find_slopes(st, st->still);
    for (k = 0; !failed && k < y->contacts; k++) {
        double moved = 0.0, size = 0.0, rate = 0.0, fastest = 0.0;
        if (!is_rigid(st, k) || y->pushes[k]) continue;
        for (n = 0; n < y->modes; n++) {
            const double C = st->C[k * y->modes + n];
            double along = 0.0;
            for (p = 0; p < y->paths; p++) along += rates[p] * slopes_of(st, p).C[(size_t)k * y->modes + n] * z[n];
            moved += C * z[n];
            size += fabs(C * z[n]);
            rate += C * v[n] + along;
            fastest += fabs(C * v[n]) + fabs(along);
        }
        if (!(fabs(moved) <= MOVED * size))
            wrong = "start as given: the states move a rigid row";
        else if (!(fabs(rate) <= RATES_MOVED * fastest))
            wrong = "start as given: the states' rates move a rigid row, or do not follow it along the path";
    }
    failed = return_to(st, &progress, failed);
    if (!wrong) return failed;
    pmr_say(why, "%s", wrong);
    return PMR_REFUSED;
}
