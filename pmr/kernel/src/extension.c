/* A free extension s: within a step its second rate is searched with which its equation of motion holds,

       F = sum over the sections that move with it of  r_i (Lambda_i + Q_i),    s_i = r_i s + o_i,
       Q_i = lambda^T (C_i z + H_i f - F_i lambda / 2),    C_i = dC / ds_i, ...

   F is the cylinder's force (cylinder.c).  Lambda_i holds section i along the boom: it carries weight, inertia and loads
   of all that moves with it, and the friction of its pads.  Q_i is the force that moves the rows: the pads' forces have a
   part along the boom where it is bent.  Each trial is a step of the boom whose paths follow generalized-alpha. */

enum { MOST_SECOND_RATES = 100 };
/* Of the forces: what is round-off; the same where a further trial comes no nearer.  By which second rates differ for a
   derivative, in m/s^2.  By how much of its range an extension may be beyond it. */
#define EXTENSION_ROUND_OFF 1e-13
#define EXTENSION_NEAR 1e-9
#define EXTENSION_DIFFERENCE 1e-2
#define EXTENSION_BEYOND 1e-5

static extension_past *past_of(pmr_state *st) { return (extension_past *)(void *)st->computed_past; }

/* Put an extension into motions (3, n) of its sections. */
static void extend(const pmr_system *y, const extension_past *now, double *motions)
{
    const double of[3] = {now->at, now->rate, now->second};
    int k, j;
    for (k = 0; k < y->extension.sections; k++) {
        const double *ratio = y->extension.ratios + 2 * k;
        for (j = 0; j < 3; j++)
            motions[j * y->motions + y->extension.moved[4 * k]] = ratio[0] * of[j] + (j ? 0.0 : ratio[1]);
    }
}

/* Q of a path, where the rows stand with `c`, in whose A is F + z_gain C S^-1 C^T. */
static double push_rows(pmr_state *st, const pmr_scheme *c, int path)
{
    const pmr_system *y = st->system;
    const path_slopes by = slopes_of(st, path);
    double *turned = st->turned, *pulled = st->weighted, *answer = st->w_divided, sum = 0.0;
    int k, l, n;
    memset(turned, 0, y->modes * sizeof(double));
    memset(pulled, 0, y->modes * sizeof(double));
    for (k = 0; k < y->contacts; k++) {
        const double now = st->lambda[k];
        if (now == 0.0) continue;
        for (n = 0; n < y->modes; n++) {
            turned[n] += by.C[(size_t)k * y->modes + n] * now;
            pulled[n] += st->C[(size_t)k * y->modes + n] * now;
        }
        for (l = 0; l < y->inputs; l++) sum += now * by.H[(size_t)k * y->ip + l] * st->loads[l];
        for (l = 0; l <= k; l++)
            sum -= (l == k ? 0.5 : 1.0) * now * st->lambda[l] * by.A[(size_t)k * y->mp + l];
    }
    sum += dot(turned, st->z, 0, y->modes);
    if (c == st->still) return sum;
    over_S(y, c, pulled, 0, y->modes, answer);
    return sum + c->z_gain * dot(turned, answer, 0, y->modes);
}

/* Force that the extension needs, where the rows stand with `c`; to `*size` what it is a sum of. */
static double find_needed_force(pmr_state *st, const pmr_scheme *c, double *size)
{
    const pmr_extension *e = &st->system->extension;
    double sum = 0.0;
    int k;
    find_slopes(st, c);
    *size = 0.0;
    for (k = 0; k < e->sections; k++) {
        const int32_t *moved = e->moved + 4 * k;
        const double rubs = moved[3] < 0 ? 0.0 : total_friction(st->system, st->friction, moved[3]);
        const double pushed = push_rows(st, c, moved[1]), ratio = e->ratios[2 * k];
        sum += ratio * (st->lambda[moved[2]] + rubs + pushed);
        *size += fabs(ratio) * (fabs(st->lambda[moved[2]]) + fabs(rubs) + fabs(pushed));
    }
    return sum;
}

/* Drive of the cylinder by motions (3, n), and its rate. */
static void read_drive(const pmr_system *y, const double *motions, double drive[2])
{
    int j;
    for (j = 0; j < 2; j++) drive[j] = y->extension.drive < 0 ? 0.0 : motions[j * y->motions + y->extension.drive];
}

/* A step to motions (4, n), of which the extension is set, that ends with a second rate; what is left of its equation
   grows with that. */
static int try_second_rate(pmr_state *st, double *motions, double second, extension_past *now, double *left, double *size)
{
    const pmr_system *y = st->system;
    const pmr_actuator *c = &y->extension.cylinder;
    const weights w = weights_of(st->settings.step, st->settings.rho_inf);
    const extension_past *old;
    double drive[2];
    int failed;
    memcpy(st->mark, st->kept, st->saved * sizeof(double));
    old = past_of(st);
    now->second = second;
    now->smooth = smoothed(&w, second, old->second, old->smooth);
    now->at = old->at + w.h * (old->rate + w.h * ((0.5 - w.beta) * old->smooth + w.beta * now->smooth));
    now->rate = old->rate + w.h * ((1.0 - w.gamma) * old->smooth + w.gamma * now->smooth);
    extend(y, now, motions);
    failed = make_one_step(st, (pmr_course){.motions = motions});
    if (failed) return failed;
    read_drive(y, motions, drive);
    now->cylinder.length = now->at;
    now->cylinder.speed = now->rate;
    find_push(c, w.h, drive, now->loaded, &past_of(st)->cylinder, &now->cylinder);
    if (isnan(now->cylinder.force)) return PMR_LOST;
    *left = find_needed_force(st, st->scheme + st->progress.active, size) - now->cylinder.force;
    *size += fabs(now->cylinder.force) + fabs(now->slope * second);
    if (c->kind == PMR_CYLINDER_OIL)
        *size += fabs(now->cylinder.pressures[0]) * c->areas[0] + fabs(now->cylinder.pressures[1]) * c->areas[1];
    return PMR_DONE;
}

/* Find the second rate by secants, between those where what is left changes its sign. */
static int find_second_rate(pmr_state *st, double *motions, extension_past *now)
{
    const pmr_progress progress = st->progress;
    double low = -INFINITY, high = INFINITY, second = now->second, left, size, last = 0.0, before = INFINITY;
    int tries, failed;
    for (tries = 0; tries < MOST_SECOND_RATES; tries++) {
        double next;
        st->progress = progress;
        failed = try_second_rate(st, motions, second, now, &left, &size);
        if (failed) return failed;
        if (tries && second != last) {
            const double slope = (left - before) / (second - last);
            if (slope > 0.0 && isfinite(slope)) now->slope = slope;
        }
        if (fabs(left) <= EXTENSION_ROUND_OFF * size || (fabs(left) <= EXTENSION_NEAR * size && fabs(left) > fabs(before) / 2.0))
            return PMR_DONE;
        if (left < 0.0)
            low = larger(low, second);
        else
            high = second < high ? second : high;
        next = now->slope > 0.0 ? second - left / now->slope : second + EXTENSION_DIFFERENCE;
        if (low < high && (!(next > low && next < high) || (fabs(left) > fabs(before) / 2.0 && high - low < INFINITY)))
            if (high - low < INFINITY) next = (low + high) / 2.0;
        last = second, before = left;
        second = next;
        if (second == last) return PMR_DONE; /* nothing is in between */
    }
    return PMR_LOST;
}

static void show_extension(pmr_state *st, const extension_past *now)
{
    const int last = st->system->computed - 1;
    *past_of(st) = *now;
    copy(st->computed, &now->cylinder.length, last);
    st->computed[last] = now->second;
}

static int step_extension(pmr_state *st, const double *given, const int32_t *rows)
{
    const pmr_system *y = st->system;
    const pmr_extension *e = &y->extension;
    const double beyond = EXTENSION_BEYOND * (e->range[1] - e->range[0]);
    const pmr_progress progress = st->progress;
    double *motions = st->motions_next;
    extension_past now = *past_of(st);
    int failed, k;
    take_motions(y, given, rows, motions);
    for (k = 0; k < e->sections; k++) motions[3 * y->motions + e->moved[4 * k]] = 3.0;
    memcpy(st->kept, st->mark, st->saved * sizeof(double));
    failed = find_second_rate(st, motions, &now);
    if (!failed && now.cylinder.emptied) failed = PMR_LOST;
    if (!failed && !(now.at >= e->range[0] - beyond && now.at <= e->range[1] + beyond)) failed = PMR_BEYOND;
    if (failed) {
        const int trouble = st->trouble;
        memcpy(st->mark, st->kept, st->saved * sizeof(double));
        st->progress = progress;
        st->placed = 0;
        (void)stand(st);
        st->trouble = trouble;
        return failed;
    }
    copy(st->motions, motions, 4 * y->motions);
    show_extension(st, &now);
    return PMR_DONE;
}

/* Start with a second rate of the extension under motions (3, n); what is left of its equation. */
static int begin_extension(pmr_state *st, int kind, const double *motions, const double *z, const double *v, double *left)
{
    const pmr_system *y = st->system;
    double size;
    int failed = pmr_frame_drivers(y, motions, st->u_next, st->quantities), k;
    if (failed) return failed;
    for (k = 0; k < y->paths; k++) st->s_rates[k] = motions[y->motions + y->frame_paths[k]];
    failed = start(st, kind, st->u_next, kind == PMR_GIVEN ? st->s_rates : NULL, z, v);
    if (failed) return failed;
    st->placed = 0;
    (void)place(st, st->still, st->u);
    *left = find_needed_force(st, st->still, &size);
    st->placed = 0;
    return PMR_DONE;
}

static int start_extension(pmr_state *st, int kind, const double *given, const double *z, const double *v)
{
    const pmr_system *y = st->system;
    const pmr_extension *e = &y->extension;
    const int n = y->motions;
    double *motions = st->motions_next, *modes = st->begun, *rates = st->begun + y->modes, drive[2], left, more;
    extension_past now = {0};
    int failed;
    take_motions(y, given, NULL, motions);
    now.at = (given[e->moved[0]] - e->ratios[1]) / e->ratios[0];
    extend(y, &now, motions); /* at rest, as an equilibrium is */
    failed = begin_extension(st, kind, motions, z, v, &left);
    if (failed) return failed;
    copy(modes, st->z, y->modes);
    copy(rates, st->v, y->modes);
    load_by_force(&e->cylinder, left, now.loaded);
    now.rate = given[n + e->moved[0]] / e->ratios[0];
    now.cylinder.length = now.at;
    now.cylinder.speed = now.rate;
    read_drive(y, motions, drive);
    find_push(&e->cylinder, 1.0, drive, now.loaded, NULL, &now.cylinder);
    extend(y, &now, motions);
    failed = begin_extension(st, PMR_GIVEN, motions, modes, rates, &left);
    now.second = 1.0;
    extend(y, &now, motions);
    if (!failed) failed = begin_extension(st, PMR_GIVEN, motions, modes, rates, &more);
    if (failed) return failed;
    now.slope = more - left;
    if (!(now.slope > 0.0)) return PMR_LOST;
    now.second = now.smooth = (now.cylinder.force - left) / now.slope;
    extend(y, &now, motions);
    failed = begin_extension(st, PMR_GIVEN, motions, modes, rates, &left);
    if (failed) return failed;
    copy(st->motions, motions, 4 * n);
    show_extension(st, &now);
    return PMR_DONE;
}

/* ---- of a luffing angle or an extension that is free ---- */

static int start_computed(pmr_state *st, int kind, const double *motions, const double *z, const double *v)
{
    return st->run ? start_luffing(st, kind, motions, z, v) : start_extension(st, kind, motions, z, v);
}

static int step_computed(pmr_state *st, const double *motions, const int32_t *rows)
{
    if (st->run) return step_luffing(st, motions);
    return all_finite(motions, 3 * st->system->motions) ? step_extension(st, motions, rows) : PMR_REFUSED;
}

/* Motions (3, n) with what is free where the state stands. */
static const double *computed_motions(pmr_state *st, const double *motions)
{
    const pmr_extension *e = &st->system->extension;
    const int n = st->system->motions, count = e->sections ? e->sections : 1;
    int j, k;
    copy(st->motions_next, motions, 3 * n);
    for (k = 0; k < count; k++) {
        const int free = e->sections ? e->moved[4 * k] : st->system->frame_angles[0];
        for (j = 0; j < 3; j++) st->motions_next[j * n + free] = st->motions[j * n + free];
    }
    return st->motions_next;
}
