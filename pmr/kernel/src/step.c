/* One part of a step: multipliers from how far the free motion violates the contacts, then the modes one by one.

       S z'' = B f + w - Omega^2 z* - D v* - C^T lambda,      A lambda = C z_free + H f - g,
       z_free = z* + z_gain S^-1 (B f + w - Omega^2 z* - D v*)

   z_free begins, at the end of the step before, without B f + w. */

/* B f and H f. */
INLINE void load_bodies(pmr_state *st, const double *f)
{
    const pmr_system *y = st->system;
    int n, l, k;
    f = with_pulls(st, f);
    for (l = 0; l < y->inputs; l++) st->loads[l] = f[l];
    for (n = 0; n < y->modes; n += VL) {
        const int32_t *touching = y->mode_inputs + 2 * (n / PMR_LANES);
        vec sum = {0.0};
        for (l = touching[0]; l < touching[1]; l++) sum += CV(y->B + l * y->modes + n) * f[l];
        V(st->push + n) = sum;
    }
    for (k = 0; k < y->contacts; k++) {
        double sum = 0.0;
        if (y->ip > MANY_INPUTS)
            sum = dot(st->H + k * y->ip, st->loads, 0, y->ip);
        else
            for (l = 0; l < y->inputs; l++) sum += st->H[k * y->ip + l] * f[l];
        st->pushed[k] = sum;
    }
}

/* sums -= C^T lambda of rows first to last. */
INLINE void subtract_rows(const pmr_state *st, int first, int last, double *sums)
{
    const pmr_system *y = st->system;
    int k, n;
    for (k = first; k < last; k++)
        if (st->lambda[k] != 0.0)
            for (n = y->row_modes[2 * k]; n < y->row_modes[2 * k + 1]; n += VL)
                V(sums + n) -= CV(st->C + k * y->modes + n) * st->lambda[k];
}

/* -S^-1 (Omega^2 z + D v) of the prediction where damping couples modes. */
static void couple(const pmr_state *st, const pmr_scheme *c, const double *z, const double *v, double *result)
{
    const pmr_system *y = st->system;
    double *forces = st->scratch;
    int k, n;
    for (n = 0; n < y->modes; n++) forces[n] = y->omega2[n] * z[n];
    for (k = 0; k < y->modes; k++)
        for (n = 0; n < y->modes; n++) forces[n] += y->damping[(size_t)k * y->modes + n] * v[k];
    for (n = 0; n < y->modes; n++) forces[n] *= -y->inertia[n];
    over_S(y, c, forces, 0, y->modes, result);
}

/* z_free of the prediction, without loads. */
static void free_motion(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int n;
    if (y->coupled) {
        couple(st, c, st->z_next, st->v_next, st->weighted);
        for (n = 0; n < y->modes; n += VL) V(st->z_free + n) = CV(st->z_next + n) + CV(st->weighted + n) * c->z_gain;
        return;
    }
    for (n = 0; n < y->modes; n += VL)
        V(st->z_free + n) =
            CV(st->z_next + n) -
            (CV(c->stiffness + n) * CV(st->z_next + n) + CV(c->damping + n) * CV(st->v_next + n)) * c->z_gain;
}

/* z_free += z_gain S^-1 B f. */
INLINE void push_free(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int n;
    if (y->coupled) {
        over_S(y, c, st->push, 0, y->modes, st->weighted);
        for (n = 0; n < y->modes; n += VL) V(st->z_free + n) += CV(st->weighted + n) * c->z_gain;
        return;
    }
    for (n = 0; n < y->modes; n += VL) V(st->z_free + n) += CV(st->push + n) * CV(c->unit + n) * c->z_gain;
}

/* ---- modes without inertia ---- */

INLINE double lasting_share(const pmr_system *y, const pmr_scheme *c, int n)
{
    const double D = y->damping[y->coupled ? (size_t)n * y->modes + n : (size_t)n];
    const double lag = D / y->omega2[n];
    return lag / (c->h + lag);
}

/* Their prediction for the step after the displacement z. */
static void predict_quasi_static(pmr_state *st, const pmr_scheme *c, const double *z)
{
    const pmr_system *y = st->system;
    int k;
    for (k = 0; k < y->quasi_static; k++) {
        const int n = y->of_modes[k];
        st->z_free[n] = st->z_next[n] = z[n] * lasting_share(y, c, n);
        st->v_next[n] = st->a_next[n] = 0.0;
    }
}

/* Undo what forces of the step before have been given in the prediction: they leave nothing here. */
static void forget_quasi_static(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int k;
    for (k = 0; k < y->quasi_static; k++) {
        const int n = y->of_modes[k];
        const double lasting = st->z_before[n] * lasting_share(y, c, n);
        st->z_free[n] += lasting - st->z_next[n];
        st->z_next[n] = lasting;
        st->v_next[n] = st->a_next[n] = 0.0;
    }
}

/* Their rates over the step that has ended, and their prediction for the next. */
static void end_quasi_static(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int k;
    for (k = 0; k < y->quasi_static; k++) {
        const int n = y->of_modes[k];
        st->v[n] = (st->z[n] - st->z_before[n]) / c->h;
    }
    predict_quasi_static(st, c, st->z);
}

/* Begin where the bodies stand, with accelerations z'' (r') and multipliers as if both had been so before. */
static void predict(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int k, n;
    for (n = 0; n < y->modes; n += VL) {
        vec a = CV(st->accelerated + n);
        V(st->z_next + n) = CV(st->z + n) + CV(st->v + n) * c->z_from_v + a * (c->z_from_force + c->z_from_share);
        V(st->v_next + n) = CV(st->v + n) + a * (c->v_from_force + c->v_from_share);
        V(st->a_next + n) = a * (c->a_from_force + c->a_from_share);
    }
    free_motion(st, c);
    if (y->hoist) predict_payload(st, c);
    for (k = 0; k < y->contacts; k++) st->force[k] = st->share[k] = y->pushing ? st->lambda[k] : 0.0;
}

/* ---- multipliers ---- */

INLINE void find_motion(pmr_state *st, double *motion)
{
    const pmr_system *y = st->system;
    int k, j;
    for (k = 0; k < y->contacts; k++)
        motion[k] = dot(st->C + k * y->modes, st->z_free, y->whole ? 0 : y->row_modes[2 * k],
                        y->whole ? y->modes : y->row_modes[2 * k + 1]) +
                    st->pushed[k];
    if (!y->pads) return;
    for (k = 0; k < y->contacts; k++) motion[k] -= st->gap[k];
    for (j = y->contacts; j < y->rows; j++)
        if (st->lambda[j] != 0.0)
            for (k = 0; k < y->contacts; k++) motion[k] -= st->A[j * y->mp + k] * st->lambda[j];
}

/* Of contacts that hold both ways, and with them the rope's forces where these follow. */
INLINE int hold(pmr_state *st, const pmr_scheme *c)
{
    double change;
    const pmr_system *y = st->system;
    int k;
    find_motion(st, st->excess);
    for (k = 0; k < y->contacts; k++) st->lambda[k] = st->excess[k];
    if (y->contacts == 1)
        st->lambda[0] *= st->factor[0];
    else
        solve(st->factor, y->contacts, y->mp, st->lambda);
    return y->hoist && !y->pads ? settle_rope(st, c, 1, &change) : PMR_DONE;
}

static int find_multipliers(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int again, failed, times = 0;
    if (!y->registers && !y->pads && !y->pushing) return hold(st, c);
    do {
        again = 0;
        if (y->pushing) {
            find_motion(st, st->motion);
            failed = settle_state(st);
            if (failed) return failed;
        } else {
            failed = hold(st, c);
            if (failed) return failed;
        }
        if (y->registers || y->pads) {
            if (times < 0) break; /* multipliers have followed once more, and nothing has changed that counts */
            again = revise(st, c, ++times);
            if (again < 0) return PMR_UNCONVERGED;
            if (again == LAST_TIME) {
                again = AGAIN;
                if (!y->pushing) times = -1;
            }
        }
        if (again == SETTLED && y->pushing && release(st, c)) {
            pmr_restart(&st->iteration); /* the step leads elsewhere */
            if (y->quasi_static) forget_quasi_static(st, c);
            if (y->coupled) { /* anew: what was taken back acts on all modes of a body */
                free_motion(st, c);
                push_free(st, c);
                push_terms(st, c);
            }
            again = AGAIN;
        }
    } while (again);
    return PMR_DONE;
}

/* ---- the step ---- */

/* The step's acceleration, its end, and the prediction of the next, from `others`, all forces on the modes. */
INLINE void advance_modes(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int n, k;
    for (n = 0; n < y->modes; n += VL) {
        vec others;
        if (y->whole) { /* all rows hold all modes: in one go */
            vec held = {0.0};
            for (k = 0; k < y->rows; k++) held += CV(st->C + k * y->modes + n) * st->lambda[k];
            V(st->pulled + n) = held;
            others = CV(st->push + n) - held;
            if (y->registers) others += CV(st->w + n);
            V(st->others + n) = others;
        } else {
            others = CV(st->others + n);
        }
        vec z = CV(st->z_next + n), v = CV(st->v_next + n), a = CV(st->a_next + n), stiffness = CV(c->stiffness + n),
            damping = CV(c->damping + n);
        vec acceleration = others * CV(c->unit + n) - stiffness * z - damping * v;
        V(st->acceleration + n) = acceleration;
        V(st->z + n) = z + acceleration * c->z_gain;
        V(st->v + n) = v + acceleration * c->v_gain;
        z = z + v * c->z_from_v + a * c->z_from_a + acceleration * c->z_from_acceleration;
        v = v + a * c->v_from_a + acceleration * c->v_from_acceleration;
        a = a * c->a_from_a + acceleration * c->a_from_acceleration;
        V(st->z_next + n) = z;
        V(st->v_next + n) = v;
        V(st->a_next + n) = a;
        V(st->z_free + n) = z - (stiffness * z + damping * v) * c->z_gain;
    }
}

/* The same where damping couples modes. */
static void advance_coupled(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    double *acceleration = st->weighted, *bent = st->turned;
    int n;
    couple(st, c, st->z_next, st->v_next, bent);
    over_S(y, c, st->others, 0, y->modes, acceleration);
    for (n = 0; n < y->modes; n++) {
        const double a = acceleration[n] + bent[n], z = st->z_next[n], v = st->v_next[n], before = st->a_next[n];
        st->acceleration[n] = a;
        st->z[n] = z + a * c->z_gain;
        st->v[n] = v + a * c->v_gain;
        st->z_next[n] = z + v * c->z_from_v + before * c->z_from_a + a * c->z_from_acceleration;
        st->v_next[n] = v + before * c->v_from_a + a * c->v_from_acceleration;
        st->a_next[n] = before * c->a_from_a + a * c->a_from_acceleration;
    }
    free_motion(st, c);
}

/* A part to loads f (i,) and amplitudes (K,) at its end, where the rows stand already. */
static int advance(pmr_state *st, const pmr_scheme *c, const double *f, const double *amplitudes)
{
    const pmr_system *y = st->system;
    int n, failed;
    load_bodies(st, f);
    push_free(st, c);
    if (y->registers || y->pads)
        expect_terms(st, c, amplitudes);
    else if (y->quasi_static)
        copy(st->z_before, st->z, y->modes);
    failed = y->hoist ? settle_hoist(st, c) : find_multipliers(st, c);
    if (failed) return failed;
    if (y->hoist) advance_payload(st, c);
    if (y->pushing) remember_forces(st, c);
    if (!y->whole || y->coupled) {
        for (n = 0; n < y->modes; n += VL) V(st->pulled + n) = CV(st->push + n);
        subtract_rows(st, 0, y->contacts, st->pulled);
        for (n = 0; n < y->modes; n += VL) {
            vec others = CV(st->pulled + n);
            V(st->others + n) = others;
            V(st->pulled + n) = CV(st->push + n) - others; /* C^T lambda, for the balance of energy */
        }
        if (y->pads) subtract_rows(st, y->contacts, y->rows, st->others);
        if (y->registers)
            for (n = 0; n < y->modes; n += VL) V(st->others + n) += CV(st->w + n);
    }
    if (y->coupled)
        advance_coupled(st, c);
    else
        advance_modes(st, c);
    return PMR_DONE;
}

/* A part to paths s, loads f and amplitudes at its end. */
static int make_part(pmr_state *st, const pmr_scheme *c, const double *u)
{
    const pmr_system *y = st->system;
    const double *f = u + y->paths, *amplitudes = f + y->inputs;
    int failed = place(st, c, u), k;
    if (y->hoist) expect_hoist(st, c, u);
    if (!failed) failed = advance(st, c, f, amplitudes);
    if (failed) return failed;
    for (k = 0; k < y->quasi_static; k++) st->v[y->of_modes[k]] = 0.0; /* they have no kinetic energy */
    if (st->settings.energy) {
        if (y->registers || y->pads) account_terms(st, c);
        account(st, c);
        if (y->hoist) account_hoist(st);
    }
    if (y->registers || y->pads) end_terms(st);
    if (y->quasi_static) end_quasi_static(st, c);
    return PMR_DONE;
}
