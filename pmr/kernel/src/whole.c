/* Momenta of machine and boom, forces on both from outside, and what has to hold the machine. */

/* Motions of step k with the machine's motion b (3, 6). */
static const double *motions_at(const pmr_machine_run *ms, int64_t k, const double *rows, const double *second)
{
    const pmr_system *y = ms->state->system;
    const int n = y->motions;
    int j;
    copy(ms->motions, ms->machine->motions + (size_t)k * 3 * n, 3 * n);
    for (j = 0; j < 3; j++)
        if (ms->machine->axes[j] >= 0) ms->motions[ms->machine->axes[j]] = second[j];
    if (ms->machine->luffs) {
        const double *of[3] = {rows, rows + 6, second};
        for (j = 0; j < 3; j++) {
            ms->motions[j * n + y->frame_angles[0]] = (j ? 0.0 : ms->machine->level) - of[j][4];
            if (y->frame_angles[1] >= 0) ms->motions[j * n + y->frame_angles[1]] = of[j][5];
        }
        return ms->motions;
    }
    for (j = 0; j < 3; j++) {
        ms->motions[y->frame_angles[2 + j]] = rows[3 + j];
        ms->motions[n + y->frame_angles[2 + j]] = rows[9 + j];
        ms->motions[2 * n + y->frame_angles[2 + j]] = second[3 + j];
    }
    return ms->motions;
}

/* Axes about which roll, pitch and yaw turn, as columns, along the ground's axes; those of a machine that luffs
   turn with its base. */
static void axes_of(const pmr_machine *m, const double *b, const pmr_turning *base, double *axes)
{
    const double c = cos(b[5]), s = sin(b[5]);
    const double column[3][3] = {{c * cos(b[4]), s * cos(b[4]), -sin(b[4])}, {-s, c, 0.0}, {0.0, 0.0, 1.0}};
    double turned[3];
    int i, j;
    for (j = 0; j < 3; j++) {
        copy(turned, column[j], 3);
        if (m->luffs) turn_out(base->R, column[j], turned);
        for (i = 0; i < 3; i++) axes[3 * i + j] = turned[i];
    }
}

static void find_carrier(const pmr_machine_run *ms, int64_t k, const double *b, carrier *c)
{
    static const double none[6];
    pmr_turning boom, base;
    int i, j, l;
    pmr_frame_turning(ms->state->system, motions_at(ms, k, b, none), &boom, &base);
    axes_of(ms->machine, b, &base, c->axes);
    copy(c->R, boom.R, 9);
    copy(c->base_R, base.R, 9);
    copy(c->base_omega, base.velocity, 3);
    for (i = 0; i < 3; i++) {
        c->v[i] = b[6 + i];
        c->omega[i] = boom.velocity[i];
        c->left[i] = boom.acceleration[i];
        for (j = 0; j < 3; j++) {
            c->turned[3 * i + j] = 0.0;
            for (l = 0; l < 3; l++) c->turned[3 * i + j] += boom.R[3 * l + i] * c->axes[3 * l + j];
        }
    }
}

/* Drivers where the machine's motion carries the boom by c, of loads those that its acceleration makes alone if
   `inertial`; loads by a hoist's rope, which `push` has by itself, are 0. */
static void drivers_at(const pmr_machine_run *ms, int64_t k, const carrier *c, const double *rows, const double *second,
                       int inertial, double *u)
{
    const pmr_system *y = ms->state->system;
    const int first = ms->machine->luffs; /* which turns about no other axis but that of slewing */
    pmr_turning boom;
    int i, j, n;
    copy(boom.R, c->R, 9);
    copy(boom.velocity, c->omega, 3);
    copy(boom.acceleration, c->left, 3);
    for (j = first; j < (first && y->frame_angles[1] < 0 ? 2 : 3); j++)
        for (i = 0; i < 3; i++) boom.acceleration[i] += c->turned[3 * i + j] * second[3 + j];
    pmr_frame_turned(y, motions_at(ms, k, rows, second), &boom,
                     inertial ? ms->machine->inertial_count : y->drivers - y->paths,
                     inertial ? ms->machine->inertial : NULL, u, ms->state->quantities);
    for (n = 0; n < y->hoist; n++) u[y->paths + y->hoist_inputs[n]] = 0.0;
}

/* Accelerations (6,) that the boom feels by second rates of the directions (6,), and the other way round. */
static void feel(const carrier *c, const double *second, double *felt)
{
    int i;
    turn_in(c->R, second, felt);
    turn_out(c->turned, second + 3, felt + 3);
    for (i = 0; i < 3; i++) felt[3 + i] += c->left[i];
}

static void seconds_of(const carrier *c, const double *felt, double *second)
{
    double turned[3];
    int i;
    turn_out(c->R, felt, second);
    for (i = 0; i < 3; i++) turned[i] = felt[3 + i] - c->left[i];
    solve_three(c->turned, 0, turned, second + 3);
}

/* Force and moment about the pivot from outside, along the ground's axes, but for what holds the machine. */
static void push(const pmr_machine_run *ms, int64_t k, const double *R, const double *axes, const double *f,
                 const double *springs, const double *lever, double *F, double *M)
{
    const pmr_machine *m = ms->machine;
    const double *pushed = m->external + 6 * (size_t)k, weight[3] = {0.0, 0.0, -m->weight[k]};
    const int inputs = ms->state->system->inputs;
    double force[3] = {0.0, 0.0, 0.0}, moment[3] = {0.0, 0.0, 0.0}, first[3], by_springs[3];
    int n, j;
    for (n = 0; n < m->sections; n++) {
        double own[6];
        for (j = 0; j < 6; j++) own[j] = dot_loose(m->loads + (size_t)(6 * n + j) * inputs, f, inputs);
        for (j = 0; j < 3; j++) force[j] += own[j], moment[j] += own[3 + j];
        add_cross(1.0, ms->of[n].d, own, moment);
    }
    if (ms->state->system->hoist) add_rope_wrench(ms->state, force, moment);
    turn_out(R, force, force);
    turn_out(R, moment, moment);
    turn_out(R, ms->boom.s[0], first);
    for (j = 0; j < 3; j++) {
        F[j] = (m->boom_mass + m->mass) * weight[j] + force[j] + pushed[j] + springs[j];
        M[j] = moment[j] + pushed[3 + j];
        first[j] += m->mass * lever[j];
    }
    add_cross(1.0, first, weight, M);
    if (springs[3] != 0.0 || springs[4] != 0.0 || springs[5] != 0.0) {
        solve_three(axes, 1, springs + 3, by_springs);
        for (j = 0; j < 3; j++) M[j] += by_springs[j];
    }
}

static void find_springs(const pmr_machine *m, int64_t k, const double *b, double *springs)
{
    const double *given = m->base_motion + 18 * (size_t)k;
    int j;
    for (j = 0; j < 6; j++)
        springs[j] = -m->stiffness[j] * (b[j] - given[j]) - m->damping[j] * (b[6 + j] - given[6 + j]);
}

/* Momenta and forces at step k with the machine's motion b, which carries the boom by c, under loads f. */
static void find_whole(pmr_machine_run *ms, int64_t k, const double *b, const carrier *c, const double *f,
                       const double *const z[3], machine_whole *w)
{
    const pmr_machine *m = ms->machine;
    boom_moments *boom = &ms->boom;
    double v[3], linear[3], angular[3], lever[3], spin[3], *P = w->momenta, *L = w->momenta + 3;
    int i, j;
    copy(w->axes, c->axes, 9);
    ms->orders = 2;
    find_boom(ms, k, z);
    turn_in(c->R, b + 6, v);
    cross(c->omega, boom->s[0], linear);
    cross(boom->s[0], v, angular);
    for (i = 0; i < 3; i++) {
        linear[i] += m->boom_mass * v[i] + boom->s[1][i];
        angular[i] += boom->h[i];
        for (j = 0; j < 3; j++) angular[i] += boom->inertia[3 * i + j] * c->omega[j];
        spin[i] = m->inertia[i] * c->base_omega[i];
    }
    turn_out(c->R, linear, P);
    turn_out(c->R, angular, L);
    turn_out(c->base_R, m->center, lever);
    turn_out(c->base_R, spin, spin);
    cross(c->base_omega, m->center, linear);
    turn_out(c->base_R, linear, linear);
    for (i = 0; i < 3; i++) {
        linear[i] = m->mass * (b[6 + i] + linear[i]);
        P[i] += linear[i];
        L[i] += spin[i];
    }
    add_cross(1.0, lever, linear, L);
    add_cross(1.0, b, P, L);
    find_springs(m, k, b, w->springs);
    if (m->cylinder.kind) push_by_cylinder(ms, k, b, w->springs);
    push(ms, k, c->R, w->axes, f, w->springs, lever, w->forces, w->forces + 3);
    add_cross(1.0, b, w->forces, w->forces + 3);
}

/* What has to hold the machine (6,), by its directions, for all to be accelerated so. */
static void find_holding_forces(pmr_machine_run *ms, int64_t k, const double *b, const double *f,
                                const double *const z[3], double *needed)
{
    const pmr_machine *m = ms->machine;
    boom_moments *boom = &ms->boom;
    pmr_turning turned, base;
    double a[3], linear[3], angular[3], spin[3], lever[3], own[3], rolled[3], axes[9], springs[6], F[3], M[3];
    const double *omega = turned.velocity, *alpha = turned.acceleration;
    int i, j;
    pmr_frame_turning(ms->state->system, motions_at(ms, k, b, b + 12), &turned, &base);
    axes_of(m, b, &base, axes);
    ms->orders = 3;
    find_boom(ms, k, z);
    turn_in(turned.R, b + 12, a);
    for (i = 0; i < 3; i++) {
        linear[i] = m->boom_mass * a[i] + boom->s[2][i];
        angular[i] = boom->h_rate[i];
        spin[i] = boom->h[i];
        for (j = 0; j < 3; j++) {
            spin[i] += boom->inertia[3 * i + j] * omega[j];
            angular[i] += boom->inertia_rate[3 * i + j] * omega[j] + boom->inertia[3 * i + j] * alpha[j];
        }
    }
    cross(omega, boom->s[0], own);
    add_cross(1.0, omega, own, linear);
    add_cross(2.0, omega, boom->s[1], linear);
    add_cross(1.0, alpha, boom->s[0], linear);
    add_cross(1.0, boom->s[0], a, angular);
    add_cross(1.0, omega, spin, angular);
    turn_out(turned.R, linear, linear);
    turn_out(turned.R, angular, angular);
    cross(base.velocity, m->center, own);
    cross(base.velocity, own, own);
    add_cross(1.0, base.acceleration, m->center, own);
    turn_out(base.R, own, own);
    turn_out(base.R, m->center, lever);
    for (i = 0; i < 3; i++) {
        own[i] = m->mass * (b[12 + i] + own[i]);
        spin[i] = m->inertia[i] * base.velocity[i];
        rolled[i] = m->inertia[i] * base.acceleration[i];
    }
    add_cross(1.0, base.velocity, spin, rolled);
    turn_out(base.R, rolled, rolled);
    add_cross(1.0, lever, own, rolled);
    find_springs(m, k, b, springs);
    if (m->cylinder.kind) push_by_cylinder(ms, k, b, springs);
    push(ms, k, turned.R, axes, f, springs, lever, F, M);
    for (i = 0; i < 3; i++) {
        needed[i] = linear[i] + own[i] - F[i];
        angular[i] += rolled[i] - M[i];
    }
    turn_in(axes, angular, needed + 3);
}
