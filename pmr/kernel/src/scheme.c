/* Generalized-alpha as factors of what a step adds up, for one length of step.

       (1 - alpha_m) a_{n+1} + alpha_m a_n = (1 - alpha_f) z''_{n+1} + alpha_f z''_n
       z_{n+1} = z_n + h z'_n + h^2 ((1/2 - beta) a_n + beta a_{n+1}),    z'_{n+1} = z'_n + h ((1 - gamma) a_n + gamma
       a_{n+1})

   A step begins with the prediction (z*, v*, a*), which is all that it needs of the steps before, and its
   acceleration z'' gives z = z* + z_gain z'', v = v* + v_gain z'', a = a* + gain z''.  A mode without inertia follows
   at once, with its damping, by backward Euler, D (z_{n+1} - z_n) / h + Omega^2 z_{n+1} = force: its prediction is
   z_n D / (D + h Omega^2), v* = a* = 0, and its S is z_gain (Omega^2 + D / h). */

/* Whether this is no mode, but fills a body up. */
INLINE int is_fill(const pmr_system *y, int n) { return y->inertia[n] == 0.0 && y->omega2[n] == 0.0; }

/* Weights of a step of h s, by the spectral radius at infinite frequency. */
typedef struct {
    double h, am, af, gamma, beta;
} weights;

static weights weights_of(double h, double rho)
{
    weights w = {h, (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0), 0.0, 0.0};
    w.gamma = 0.5 + w.af - w.am;
    w.beta = (w.gamma + 0.5) * (w.gamma + 0.5) / 4.0;
    return w;
}

static void set_factors(pmr_scheme *c, double h, double rho)
{
    const weights w = weights_of(h, rho);
    const double am = w.am, af = w.af, gamma = w.gamma, beta = w.beta, gain = (1.0 - af) / (1.0 - am);
    const double a_from_a = -am / (1.0 - am), a_from_acceleration = (af - am * gain) / (1.0 - am);
    c->h = h;
    c->gain = gain;
    c->z_gain = beta * (h * h) * gain;
    c->v_gain = gamma * h * gain;
    c->z_from_v = h;
    c->z_from_a = h * h * (0.5 - beta + beta * a_from_a);
    c->v_from_a = h * (1.0 - gamma + gamma * a_from_a);
    c->z_from_acceleration = c->z_gain + h * c->v_gain + h * h * ((0.5 - beta) * gain + beta * a_from_acceleration);
    c->v_from_acceleration = c->v_gain + h * ((1.0 - gamma) * gain + gamma * a_from_acceleration);
    c->a_from_a = a_from_a;
    c->a_from_acceleration = a_from_acceleration;
    c->a_from_force = af / (1.0 - am);
    c->a_from_share = a_from_a;
    c->v_from_force = h * gamma * c->a_from_force;
    c->v_from_share = h * (1.0 - gamma + gamma * a_from_a);
    c->z_from_force = h * h * beta * c->a_from_force;
    c->z_from_share = h * h * (0.5 - beta + beta * a_from_a);
}

static void factors_alone(double h, double rho, pmr_factors *factors)
{
    pmr_scheme c;
    set_factors(&c, h, rho);
    *factors = (pmr_factors){.h = c.h,
                             .gain = c.gain,
                             .v_gain = c.v_gain,
                             .z_gain = c.z_gain,
                             .a_from_force = c.a_from_force,
                             .a_from_share = c.a_from_share,
                             .v_from_force = c.v_from_force,
                             .v_from_share = c.v_from_share,
                             .z_from_force = c.z_from_force,
                             .z_from_share = c.z_from_share};
}

/* result = S^-1 x of modes first to last. */
static void over_S(const pmr_system *y, const pmr_scheme *c, const double *x, int first, int last, double *result)
{
    int k, n;
    if (!y->coupled) {
        for (n = first; n < last; n += VL) V(result + n - first) = CV(x + n - first) * CV(c->unit + n);
        return;
    }
    for (k = first; k < last; k++) result[k - first] = 0.0;
    for (k = first; k < last; k++) { /* the inverse is symmetric */
        const double *row = c->inverse + (size_t)k * y->modes, share = x[k - first];
        for (n = first; n < last; n += VL) V(result + n - first) += CV(row + n) * share;
    }
}

/* S^-1 of damping that couples modes, with `work` (2, r', r'); 1 if S is singular. */
static int set_inverse(const pmr_system *y, pmr_scheme *c, double *work)
{
    const size_t r = y->modes;
    double *factor = work + r * r;
    size_t k, n;
    for (k = 0; k < r; k++)
        for (n = 0; n < r; n++)
            work[k * r + n] = y->damping[k * r + n] * (y->inertia[n] == 0.0 ? c->z_gain / c->h : c->v_gain);
    for (n = 0; n < r; n++) work[n * r + n] += is_fill(y, (int)n) ? 1.0 : y->inertia[n] + y->omega2[n] * c->z_gain;
    for (k = 0; k < r; k++)
        if (!factorise(work + k * r, factor, (int)k, (int)r)) return 1;
    memset(c->inverse, 0, r * r * sizeof(double));
    for (k = 0; k < r; k++) {
        c->inverse[k * r + k] = 1.0;
        solve(factor, (int)r, (int)r, c->inverse + k * r);
    }
    for (k = 0; k < r; k++)
        for (n = 0; n < k; n++)
            c->inverse[k * r + n] = c->inverse[n * r + k] = 0.5 * (c->inverse[k * r + n] + c->inverse[n * r + k]);
    return 0;
}

static int set_scheme(const pmr_system *y, pmr_scheme *c, double h, double rho, double *work)
{
    const size_t r = y->modes;
    size_t k, l, n;
    set_factors(c, h, rho);
    for (n = 0; n < r; n++) {
        const double D = y->coupled ? 0.0 : y->damping[n];
        const double S =
            y->inertia[n] + y->omega2[n] * c->z_gain + D * (y->inertia[n] == 0.0 ? c->z_gain / h : c->v_gain);
        c->unit[n] = S > 0.0 ? 1.0 / S : 0.0; /* what fills a body up has none */
        c->stiffness[n] = y->inertia[n] * y->omega2[n] * c->unit[n];
        c->damping[n] = y->inertia[n] * D * c->unit[n];
    }
    if (y->coupled && set_inverse(y, c, work)) return 1;
    memcpy(c->F0, y->F0, (size_t)y->rows * y->mp * sizeof(double));
    for (k = 0; k < (size_t)y->rows; k++) {
        over_S(y, c, y->C0 + k * r, 0, (int)r, work);
        for (l = 0; l < (size_t)y->rows; l++) c->F0[k * y->mp + l] += c->z_gain * dot(work, y->C0 + l * r, 0, (int)r);
    }
    return 0;
}
