/* Outputs y = O z + W f - X(s) lambda, as sums of columns times their shares, and forces of all contacts.  Reactions of
   rigid supports are such outputs, to which rates of modes and terms add (pmr/kernel/further.py). */

/* out += columns times their shares, of those outputs first to last; `kind` 0: modes, 1: inputs, 2: rows. */
static void add_spans(const pmr_observed *set, int kind, const double *columns, const double *shares, int first,
                      int last, double *out)
{
    int n;
    for (n = first; n < last; n += PMR_SPAN) {
        const int32_t *span = set->spans + 6 * (n / PMR_SPAN) + 2 * kind;
        add_columns(columns + (size_t)span[0] * set->width + n, set->width, shares + span[0], span[1] - span[0],
                    out + n, last - n < PMR_SPAN ? last - n : PMR_SPAN);
    }
}

/* Outputs of a set, those from `first` (a multiple of PMR_SPAN) to `last` (of PMR_LANES) alone, of z, f (or NULL: none)
   and multipliers of the state; with `change` (rows) of what a seed makes of z, f, multipliers and, unless NULL,
   drivers u. */
static void find_outputs(pmr_state *st, const pmr_observed *set, int first, int last, const double *z, const double *f,
                         const double *change, const double *u, double *out)
{
    const pmr_system *y = st->system;
    const double *lambda = change ? change : st->lambda;
    double *shares = st->scratch;
    int k, b, p;
    memset(out, 0, (size_t)set->width * sizeof(double));
    add_spans(set, 0, set->shapes, z, first, last, out);
    if (f) add_spans(set, 1, set->direct, f, first, last, out);
    if (!y->whole) {
        for (k = 0; k < y->rows; k++) shares[k] = -lambda[k];
        add_spans(set, 2, set->X0, shares, first, last, out);
    }
    for (b = 0; b < y->blocks; b++) {
        const pmr_block *block = y->block_list + b;
        const int32_t *of = y->reaction_blocks + 4 * b;
        const int begin = set->reactions ? of[0] : block->first_output, m = block->rows,
                  width = PMR_UP(set->reactions ? of[1] : block->outputs),
                  powers = set->reactions ? of[2] : block->powers_X, at = set->reactions ? of[3] : block->at_X,
                  skipped = first > begin ? (first - begin) / PMR_LANES * PMR_LANES : 0,
                  end = last < begin + width ? PMR_UP(last - begin) : width;
        const double *ends = y->path_ends + 2 * block->path, s = st->s[block->path],
                     ds = u && s >= ends[0] && s <= ends[1] ? u[block->path] : 0.0;
        if (skipped >= end) continue;
        for (k = 0; k < m; k++) {
            const int row = y->block_rows[block->at_rows + k];
            double share = -lambda[row], before = 0.0, moved = change ? st->lambda[row] * ds : 0.0;
            for (p = powers - 1; p >= 0; p--) { /* times x^q; a place that moves adds q x^(q - 1) */
                shares[p * m + k] = change ? share - moved * (powers - 1 - p) * before : share;
                before = p == powers - 1 ? 1.0 : before * st->x[b];
                share *= st->x[b];
            }
        }
        add_columns(in_interval(st, b, set->table, at, powers, m * width) + skipped, width, shares, powers * m,
                    out + begin + skipped, end - skipped);
    }
}

/* Forces (forces,) of all contacts from multipliers; cylinders bear the friction of their joints too. */
static void forces_of(pmr_state *st, const double *lambda, const double *friction, double *forces)
{
    const pmr_system *y = st->system;
    double *borne = st->entries;
    int k;
    for (k = 0; k < y->mp; k++) borne[k] = k < y->contacts ? lambda[k] : 0.0;
    for (k = 0; friction && k < y->joints; k++)
        if (y->joint_cylinders[k] >= 0) borne[y->joint_cylinders[k]] += total_friction(y, friction, k);
    for (k = 0; k < y->forces; k++) forces[k] = dot(y->shares + k * y->mp, borne, 0, y->mp);
}

static void outputs(pmr_state *st, double *y_out, double *forces)
{
    const pmr_system *y = st->system;
    if (forces) forces_of(st, st->lambda, st->friction, forces);
    if (!y_out) return;
    find_outputs(st, y->observed, 0, y->op, st->z, st->u + y->paths, NULL, NULL, st->values);
    memcpy(y_out, st->values, y->outputs * sizeof(double));
}

/* reactions += what rates v and terms with these amplitudes and x = (z, v) add to them. */
static void add_supports(const pmr_system *y, const double *v, const double *amplitudes, const double *z,
                         const double *rates, double *reactions)
{
    int k, e;
    if (v) add_columns(y->reaction_rates, y->hp, v, y->modes, reactions, y->hp);
    for (k = 0; k < y->terms; k++)
        for (e = y->support_first[k]; e < y->support_first[k + 1]; e++) {
            const int32_t *at = y->support_entries + 2 * e;
            const double x = at[1] < y->modes ? z[at[1]] : rates[at[1] - y->modes];
            reactions[at[0]] -= amplitudes[k] * y->support_values[e] * x;
        }
}

/* Outputs unless these are left out, reactions, forces and a rope's wrench on its winch one after the other, as frame.c
   reads them. */
static void find_all(pmr_state *st, int with_outputs, double *values)
{
    const pmr_system *y = st->system;
    const double *f = st->u + y->paths;
    if (with_outputs) find_outputs(st, y->observed, 0, y->op, st->z, f, NULL, NULL, values);
    find_outputs(st, y->observed + 1, 0, y->hp, st->z, f, NULL, NULL, values + y->op);
    add_supports(y, st->v, f + y->inputs, st->z, st->v, values + y->op);
    forces_of(st, st->lambda, st->friction, values + y->op + y->hp);
    memset(values + y->op + y->hp + y->forces, 0, 6 * sizeof(double));
    if (y->hoist) show_winch_wrench(st, values + y->op + y->hp + y->forces);
}

/* Outputs of a hoist, and behind them those of a free luffing angle or extension. */
static void show_behind(pmr_state *st, double *to)
{
    if (st->system->hoist) show_hoist(st, to);
    copy(to + (st->system->hoist ? PMR_HOIST_OUTPUTS : 0), st->computed, st->system->computed);
}

static int further_outputs(pmr_state *st, double *further)
{
    const pmr_system *y = st->system;
    find_all(st, 1, st->values);
    copy(further, st->values + y->op, y->reactions);
    show_behind(st, further + y->reactions + 3 * y->has_tip + y->has_cylinder + y->ground);
    return y->motions ? pmr_frame_outputs(y, st->motions, NULL, st->values, NULL, further, NULL) : PMR_DONE;
}

/* What is asked for: numbers (count,) of values (count,). */
typedef struct {
    int count;
    const int32_t *numbers;
    double *values;
} asked;

/* Lists of some outputs and forces, by their numbers among all outputs and, behind these, all forces and outputs of a hoist,
   of a free luffing angle or extension and of outriggers, and motions of a frame.  Where the outputs of outriggers are not
   found, their lists are told in `failed_lists`, a bit for each. */
static int observe_lists(pmr_state *st, int lists, const asked *of, int *failed_lists)
{
    const pmr_system *y = st->system;
    const int outputs = y->outputs, behind = outputs + y->forces, to_forces = y->op + y->hp - outputs,
              ground = behind + (y->hoist ? PMR_HOIST_OUTPUTS : 0) + y->computed, motions = ground + y->ground;
    int first = outputs, last = -1, forces = 0, stands = 0, failed = PMR_DONE, l, k;
    for (l = 0; l < lists; l++)
        for (k = 0; k < of[l].count; k++) {
            const int n = of[l].numbers[k];
            forces |= n >= outputs && n < ground;
            if (n >= ground && n < motions) stands |= 1 << l;
            first = n < first ? n : first;
            last = n < outputs && n > last ? n : last;
        }
    if (stands && y->ground_reads_outputs) first = 0, last = outputs - 1;
    if (last >= 0)
        find_outputs(st, y->observed, first / PMR_SPAN * PMR_SPAN, PMR_UP(last + 1), st->z, st->u + y->paths, NULL,
                     NULL, st->values);
    if (stands) {
        find_all(st, 0, st->values);
        failed = pmr_ground_outputs(y, st->motions, NULL, st->values, NULL, st->shown, NULL);
    } else if (forces) {
        forces_of(st, st->lambda, st->friction, st->values + y->op + y->hp);
    }
    if (forces) show_behind(st, st->values + y->op + y->hp + y->forces + 6);
    for (l = 0; l < lists; l++)
        for (k = 0; k < of[l].count; k++) {
            const int n = of[l].numbers[k];
            of[l].values[k] = n >= motions   ? st->motions[n - motions]
                              : n >= ground  ? st->shown[n - ground]
                              : n >= behind  ? st->values[n + to_forces + 6]
                              : n >= outputs ? st->values[n + to_forces]
                                             : st->values[n];
        }
    *failed_lists = failed ? stands : 0;
    return failed;
}

static int observe(pmr_state *st, int count, const int32_t *numbers, double *values)
{
    int unused;
    return observe_lists(st, 1, &(asked){count, numbers, values}, &unused);
}

static int observe_and_watch(pmr_state *st, int count, const int32_t *numbers, double *values, const pmr_limits *w)
{
    const int watched = st->progress.step % PMR_SELDOM ? w->often : w->count;
    const asked of[2] = {{numbers ? count : 0, numbers, values}, {w->first[watched], w->numbers, w->values}};
    int failed_lists;
    const int failed = observe_lists(st, 2, of, &failed_lists);
    if (!numbers) outputs(st, values, NULL);
    if (failed) return failed_lists & 1 ? failed : PMR_DONE;
    return -1 - pmr_beyond(w, watched);
}
