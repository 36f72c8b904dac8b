/* A free extension s: within each part of a step its second rate is searched with which its equation of motion holds,

       F = sum over the sections that move with it of  r_i (Lambda_i + Q_i),    s_i = r_i s + o_i,
       Q_i = lambda^T (C_i z + H_i f - F_i lambda / 2),    C_i = dC / ds_i, ...

   F is the cylinder's force (cylinder.c).  Lambda_i holds section i along the boom: it carries weight, inertia and loads
   of all that moves with it, and the friction of its pads.  Q_i is the force that moves the rows: the pads' forces have a
   part along the boom where it is bent.  Each trial is a part of the boom's step whose paths follow generalized-alpha. */

enum { MOST_SECOND_RATES = 100 };
/* Of the forces: what is round-off; the same where a further trial comes no nearer.  By which second rates differ for a
   derivative, in m/s^2.  By how much of its range an extension may be beyond it. */
#define EXTENSION_ROUND_OFF 1e-13
#define EXTENSION_NEAR 1e-9
#define EXTENSION_DIFFERENCE 1e-2
#define EXTENSION_BEYOND 1e-5

static extension_past *past_of(pmr_state *st) { return (extension_past *)(void *)st->computed_past; }

static void show_extension(pmr_state *st, const extension_past *now)
{
    const int last = st->system->computed - 1;
    *past_of(st) = *now;
    copy(st->computed, &now->cylinder.length, last);
    st->computed[last] = now->second;
}

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

/* Motions (3, n) with the extension where it stands. */
static const double *extended_motions(pmr_state *st, const double *motions)
{
    if (motions != st->motions_now) copy(st->motions_now, motions, 3 * st->system->motions);
    extend(st->system, past_of(st), st->motions_now);
    return st->motions_now;
}

/* Drive of the cylinder by motions (3, n), and its rate. */
static void read_drive(const pmr_system *y, const double *motions, double drive[2])
{
    int j;
    for (j = 0; j < 2; j++) drive[j] = y->extension.drive < 0 ? 0.0 : motions[j * y->motions + y->extension.drive];
}

/* What a second rate is searched for: a part of a step with such a scheme, or a start of a kind with given modes, where
   the scheme is NULL; motions (3, n), of which the extension is set. */
typedef struct {
    const pmr_scheme *scheme;
    double *motions;
    int kind;
    const double *z, *v;
} occasion;

static int try_part(pmr_state *st, const occasion *at, extension_past *now, double *needed, double *size)
{
    const pmr_system *y = st->system;
    const weights w = weights_of(at->scheme->h, st->settings.rho_inf);
    const extension_past *old = past_of(st);
    double drive[2];
    int failed;
    now->smooth = smoothed(&w, now->second, old->second, old->smooth);
    now->at = old->at + w.h * (old->rate + w.h * ((0.5 - w.beta) * old->smooth + w.beta * now->smooth));
    now->rate = old->rate + w.h * ((1.0 - w.gamma) * old->smooth + w.gamma * now->smooth);
    extend(y, now, at->motions);
    pmr_frame_drivers(y, at->motions, st->u_next, st->quantities);
    if (!all_finite(st->u_next, y->drivers)) return PMR_NOT_FINITE;
    failed = make_part(st, at->scheme, st->u_next);
    if (failed) return failed;
    *needed = find_needed_force(st, at->scheme, size);
    read_drive(y, at->motions, drive);
    now->cylinder.length = now->at;
    now->cylinder.speed = now->rate;
    find_push(&y->extension.cylinder, w.h, drive, NULL, &old->cylinder, &now->cylinder);
    return PMR_DONE;
}

static int try_start(pmr_state *st, const occasion *at, const extension_past *now, double *needed, double *size)
{
    const pmr_system *y = st->system;
    int failed, k;
    extend(y, now, at->motions);
    failed = pmr_frame_drivers(y, at->motions, st->u_next, st->quantities);
    if (failed) return failed;
    for (k = 0; k < y->paths; k++) st->s_rates[k] = at->motions[y->motions + y->frame_paths[k]];
    failed = start(st, at->kind, st->u_next, at->kind == PMR_GIVEN ? st->s_rates : NULL, at->z, at->v);
    if (failed) return failed;
    st->placed = 0;
    (void)place(st, st->still, st->u);
    *needed = find_needed_force(st, st->still, size);
    st->placed = 0;
    return PMR_DONE;
}

/* Find the second rate by secants, between those where what is left of the equation, which grows with it, changes its
   sign.  A pad that lets go makes it jump: then a part may end where it changes its sign. */
static int find_second_rate(pmr_state *st, const occasion *at, extension_past *now)
{
    const pmr_actuator *c = &st->system->extension.cylinder;
    const pmr_progress progress = st->progress;
    bracket between = {-INFINITY, INFINITY, INFINITY};
    double left, size, last = 0.0, left_last = 0.0;
    int tries, failed;
    memcpy(st->kept, st->mark, st->saved * sizeof(double));
    for (tries = 0; tries < MOST_SECOND_RATES; tries++) {
        if (tries && at->scheme) { /* return to where the part begins */
            memcpy(st->mark, st->kept, st->saved * sizeof(double));
            st->progress = progress;
            if (st->system->pushing) st->factored = -1; /* other contacts were closed there */
        }
        failed = at->scheme ? try_part(st, at, now, &left, &size) : try_start(st, at, now, &left, &size);
        if (failed) return failed;
        left -= now->cylinder.force;
        if (!isfinite(left)) return isnan(now->cylinder.force) ? PMR_LOST : PMR_NOT_FINITE;
        size += fabs(now->cylinder.force) + fabs(now->slope * now->second);
        if (c->kind == PMR_CYLINDER_OIL)
            size += fabs(now->cylinder.pressures[0]) * c->areas[0] + fabs(now->cylinder.pressures[1]) * c->areas[1];
        if (tries) {
            const double slope = (left - left_last) / (now->second - last);
            if (slope > 0.0 && isfinite(slope)) now->slope = slope;
        }
        if (fabs(left) <= EXTENSION_ROUND_OFF * size ||
            (fabs(left) <= EXTENSION_NEAR * size && fabs(left) > between.before / 2.0))
            return PMR_DONE;
        last = now->second, left_last = left;
        now->second = keep_between(&between, last, left,
                                   last - (now->slope > 0.0 ? left / now->slope : copysign(EXTENSION_DIFFERENCE, left)));
        if (now->second == last) return at->scheme ? PMR_DONE : PMR_LOST; /* a part may end at a jump, a start not */
    }
    return PMR_LOST;
}

/* A part of a step in which the extension moves by itself; its drivers are left in `u_next`. */
static int make_extended_part(pmr_state *st, const pmr_scheme *c, const pmr_course *course, int part, int parts)
{
    const pmr_system *y = st->system;
    const pmr_extension *e = &y->extension;
    const double beyond = EXTENSION_BEYOND * (e->range[1] - e->range[0]);
    const int n = y->motions, columns = 3 + y->drivers;
    double *motions = st->motions_now;
    extension_past now = *past_of(st);
    int failed, k;
    (void)extended_motions(st, course_motions(st, course, part, parts));
    failed = find_second_rate(st, &(occasion){.scheme = c, .motions = motions}, &now);
    if (failed) return failed;
    if (now.cylinder.emptied) return PMR_LOST;
    if (!(now.at >= e->range[0] - beyond && now.at <= e->range[1] + beyond)) return PMR_BEYOND;
    show_extension(st, &now);
    if (course->ends) {
        double *to = course->ends + (size_t)(part - 1) * columns;
        to[0] = now.at, to[1] = now.rate, to[2] = now.second;
        copy(to + 3, st->u_next, y->drivers);
    }
    if (part < parts) return PMR_DONE;
    copy(st->motions, motions, 3 * n);
    for (k = 0; k < n; k++) st->motions[3 * n + k] = course->motions ? course->motions[3 * n + k] : 3.0;
    return PMR_DONE;
}

/* Start with the cylinder loaded by what holds the section at rest, and with the second rate that its drive then gives;
   an equilibrium is one under the accelerations by this second rate. */
static int start_extension(pmr_state *st, int kind, const double *given, const double *z, const double *v)
{
    const pmr_system *y = st->system;
    const pmr_extension *e = &y->extension;
    const int n = y->motions;
    const occasion at = {.motions = st->motions_next, .kind = kind, .z = z, .v = v};
    double drive[2], loaded[3], held, size;
    extension_past now = {0};
    int failed;
    take_motions(y, given, NULL, at.motions);
    now.at = (given[e->moved[0]] - e->ratios[1]) / e->ratios[0];
    failed = try_start(st, &at, &now, &held, &size);
    if (failed) return failed;
    load_by_force(&e->cylinder, held, loaded);
    now.rate = given[n + e->moved[0]] / e->ratios[0];
    now.cylinder.length = now.at;
    now.cylinder.speed = now.rate;
    read_drive(y, at.motions, drive);
    find_push(&e->cylinder, 1.0, drive, loaded, NULL, &now.cylinder);
    failed = find_second_rate(st, &at, &now);
    if (failed) return failed;
    now.smooth = now.second;
    copy(st->motions, at.motions, 4 * n);
    show_extension(st, &now);
    return PMR_DONE;
}

/* ---- of a luffing angle or an extension that is free ---- */

static int start_computed(pmr_state *st, int kind, const double *motions, const double *z, const double *v)
{
    return st->run ? start_luffing(st, kind, motions, z, v) : start_extension(st, kind, motions, z, v);
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
