/* Linear models of steps for outputs that are chosen, with rates of those that are velocities and accelerations. */

/* Columns of a matrix (., columns), those of a row, by their numbers. */
static void pick(const double *row, const int32_t *numbers, int count, double *to)
{
    int k;
    for (k = 0; k < count; k++) to[k] = row[numbers[k]];
}

/* How the next prediction and the end of a step follow from the prediction and the acceleration, mode by mode: the seeds
   of one mode are those of all. */
static void linear_courses(pmr_state *st, const pmr_chosen *c, double *to)
{
    const pmr_scheme *scheme = next_scheme(st);
    const int modes = st->system->modes;
    double *room = st->seeds;
    seed d = {.z_next = room, .v_next = room + modes, .a_next = room + 2 * modes, .z = room + 3 * modes,
              .acceleration = room + 5 * modes};
    int from, part, j, n;
    for (from = 0; from < 4; from++) {
        memset(room, 0, 6 * modes * sizeof(double));
        for (n = 0; n < modes; n++) {
            double *z = d.z + n, *v = z + modes, *acceleration = d.acceleration + n;
            (from < 3 ? room + from * modes : d.acceleration)[n] = 1.0;
            *z = d.z_next[n] + scheme->z_gain * *acceleration;
            *v = d.v_next[n] + scheme->v_gain * *acceleration;
        }
        for (part = 3; part < 5; part++)
            for (j = 0; j < c->modes; j++) to[(part * 4 + from) * c->modes + j] = room[part * modes + c->at_modes[j]];
        predict_seed(st, scheme, &d);
        for (part = 0; part < 3; part++)
            for (j = 0; j < c->modes; j++) to[(part * 4 + from) * c->modes + j] = room[part * modes + c->at_modes[j]];
    }
}

static int linear_part(pmr_state *st, const pmr_scheme *scheme, const pmr_chosen *c, const double *u,
                       const pmr_linear_step *to)
{
    const pmr_system *y = st->system;
    const int r = c->modes, inputs = c->inputs, o = y->outputs;
    int column, k, j, values = 0;
    seed d;
    const int failed = open_seeds(st, scheme, u, &d);
    if (failed) return failed;
    for (k = 0; k < c->outputs; k++) values |= !c->orders[k] && c->columns[k] < o;
    for (column = 0; column < 2 * r + inputs; column++) {
        const int of_load = column >= 2 * r, width = of_load ? inputs : 2 * r, at = of_load ? column - 2 * r : column;
        const size_t number = of_load ? 3 * (size_t)y->modes + c->loads[at]
                                      : (size_t)(at / r) * y->modes + c->at_modes[at % r];
        if (follow_column(st, scheme, u, number, &d)) return PMR_UNCONVERGED;
        for (j = 0; j < r; j++) (of_load ? to->G : to->R)[j * width + at] = d.acceleration[c->at_modes[j]];
        if (values) seed_outputs(st, &d);
        for (k = 0; k < c->outputs; k++) {
            double *entry = (of_load ? to->D : to->C) + k * width + at;
            if (c->orders[k])
                *entry = 0.0; /* rates follow where they are known */
            else if (c->columns[k] < o)
                *entry = d.y[c->columns[k]];
            else /* a force: of all multipliers */
                *entry = dot_loose(y->shares + (c->columns[k] - o) * y->mp, d.lambda, y->contacts);
        }
    }
    return PMR_DONE;
}

static int linear_matrices(pmr_state *st, const pmr_chosen *c, const double *u, const pmr_linear_step *to)
{
    const pmr_progress progress = st->progress;
    if (st->system->hoist || st->system->computed) return PMR_REFUSED;
    memcpy(st->began, st->mark, st->saved * sizeof(double));
    return return_to(st, &progress, linear_part(st, next_scheme(st), c, u, to));
}

/* Shapes Y (q, r) of outputs with rates, and accelerations (r,), where the state stands under drivers u; friction stays
   as it is. */
static int find_shapes(pmr_state *st, const pmr_chosen *c, const double *u, const pmr_linear_step *to)
{
    const pmr_system *y = st->system;
    double *unit = st->seeds;
    problem of_mode;
    int failed = stand_under(st, u), j, k;
    if (!failed) failed = find_position_forces(st, 0, NULL);
    if (failed) return failed;
    accelerate(st, st->u + y->paths, st->acceleration);
    pick(st->acceleration, c->at_modes, c->modes, to->motion + 2 * c->modes);
    memset(unit, 0, y->modes * sizeof(double));
    of_mode = giving_problem(st, st->excess, st->motion);
    for (j = 0; j < c->modes && !failed; j++) {
        unit[c->at_modes[j]] = 1.0;
        for (k = 0; k < y->contacts; k++) st->excess[k] = st->C[(size_t)k * y->modes + c->at_modes[j]];
        for (k = 0; k < y->mp; k++) st->motion[k] = 0.0;
        failed = solve_closed(&of_mode);
        if (failed) st->trouble = of_mode.trouble;
        find_outputs(st, y->observed, 0, y->op, unit, NULL, st->motion, NULL, st->changes);
        for (k = 0; k < c->outputs; k++)
            to->shapes[k * c->modes + j] = c->orders[k] ? st->changes[c->columns[k]] : 0.0;
        unit[c->at_modes[j]] = 0.0;
    }
    return failed;
}

static int linear_outputs(pmr_state *st, const pmr_chosen *c, const double *u, const pmr_linear_step *to)
{
    const pmr_system *y = st->system;
    const pmr_progress progress = st->progress;
    const int r = c->modes;
    int k, failed = observe(st, c->outputs, c->columns, to->reference), rates = 0;
    for (k = 0; k < c->outputs; k++) rates |= c->orders[k];
    if (failed || !rates) return failed;
    if (y->hoist || y->computed || y->motions) return PMR_REFUSED;
    pick(st->z, c->at_modes, r, to->motion);
    pick(st->v, c->at_modes, r, to->motion + r);
    memcpy(st->began, st->mark, st->saved * sizeof(double));
    failed = return_to(st, &progress, find_shapes(st, c, u, to));
    for (k = 0; k < c->outputs && !failed; k++)
        to->loaded[k] = to->reference[k] - dot_loose(to->shapes + k * r, to->motion, r);
    return failed;
}

/* First and second rate of a number that was a, is b and becomes c, each h later; NULL where there is none. */
static void differentiate_course(const double *a, const double *b, const double *c, double h, double rates[2])
{
    rates[0] = a && c ? (*c - *a) / (2.0 * h) : c ? (*c - *b) / h : a ? (*b - *a) / h : 0.0;
    rates[1] = a && c ? (*c - 2.0 * *b + *a) / (h * h) : 0.0;
}

#define AT(array, k) ((array) ? (array) + (k) : NULL)

static void output_rates(const pmr_chosen *c, const double *courses, double step, const pmr_linear_step *before,
                         const pmr_linear_step *now, const pmr_linear_step *after)
{
    const int r = c->modes, inputs = c->inputs;
    int k, j, i, part;
    for (k = 0; k < c->outputs; k++) {
        double loaded[2], *C = now->C + k * 2 * r, *D = now->D + k * inputs;
        const int order = c->orders[k];
        if (!order) continue;
        memset(C, 0, 2 * r * sizeof(double));
        memset(D, 0, inputs * sizeof(double));
        differentiate_course(before ? before->loaded + k : NULL, now->loaded + k, after ? after->loaded + k : NULL, step,
                             loaded);
        now->reference[k] = loaded[order - 1];
        for (j = 0; j < r; j++) {
            const int at = k * r + j;
            double rates[2], by[3], through;
            differentiate_course(before ? before->shapes + at : NULL, now->shapes + at,
                                 after ? after->shapes + at : NULL, step, rates);
            by[0] = rates[order - 1];
            by[1] = order == 1 ? now->shapes[at] : 2.0 * rates[0];
            by[2] = order == 1 ? 0.0 : now->shapes[at];
            through = by[2];
            for (part = 0; part < 2; part++) { /* z and z' at the end, from z* and v* and by the acceleration */
                const double *of_end = courses + (12 + 4 * part) * r + j;
                for (i = 0; i < 2; i++) C[i * r + j] += by[part] * of_end[i * r];
                through += by[part] * of_end[3 * r];
            }
            for (i = 0; i < 3; i++) now->reference[k] += by[i] * now->motion[i * r + j];
            for (i = 0; i < 2 * r; i++) C[i] += through * now->R[j * 2 * r + i];
            for (i = 0; i < inputs; i++) D[i] += through * now->G[j * inputs + i];
        }
    }
}
