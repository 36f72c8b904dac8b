/* Terms that vary in time, w = -sum c_k (V_k z' + G_k z), at the end of a step as all other forces, so that the
   scheme keeps its order.

   S, the rows and their factor stay those of the constant matrices: w begins with what a cubic through the four steps
   before makes of it, and multipliers and w are found anew until w no longer changes.  Each time its error is
   multiplied by the largest ratio of z_gain x G x + v_gain x V x to x S x, which is below the share of the buckling
   load with any step.  Where that is not small, as under a tension that makes most of the stiffness, the iterates are
   extrapolated (extrapolation.c).

   Friction is iterated beside it (friction.c). */

#define MOST_TIMES 100
#define DIVERGED 1e6
/* A change that is foreseen to be so much smaller than what counts as none is not looked at, but for one in so many. */
#define FORESEEN 0.1
#define MOST_TRUSTED 16
enum { SETTLED = 0, AGAIN = 1, LAST_TIME = 2 };

/* The terms' sum with these amplitudes (K,), where they are others than before. */
static void combine_terms(pmr_state *st, const double *amplitudes)
{
    const pmr_system *y = st->system;
    const int32_t *registers_of = y->registers_of;
    const double *entries = y->entry_values;
    double *now = st->now;
    int same = 1, k, e, n;
    for (k = 0; k < y->terms; k++) {
        same = same && amplitudes[k] == st->known_amplitudes[k];
        st->known_amplitudes[k] = amplitudes[k];
    }
    if (same) return;
    memset(now, 0, (size_t)PMR_LANES * y->registers * sizeof(double));
    for (k = 0; k < y->terms; k++) {
        const double amplitude = amplitudes[k];
        const int last = y->first_entry[k + 1];
        if (amplitude == 0.0) continue;
        for (e = y->first_entry[k]; e < last; e++)
            for (n = 0; n < PMR_LANES; n += VL)
                V(now + PMR_LANES * registers_of[e] + n) += CV(entries + (size_t)PMR_LANES * e + n) * amplitude;
    }
}

/* w of displacements z and rates v. */
static void find_terms(const pmr_state *st, const double *z, const double *v, double *w)
{
    const pmr_system *y = st->system;
    int k, u, n;
    for (k = 0; k < y->modes / PMR_LANES; k++) {
        const int32_t *row = y->of_rows + 3 * k;
        for (n = 0; n < PMR_LANES; n += VL) {
            vec of_z = {0.0}, of_v = {0.0};
            for (u = row[0]; u < row[1]; u++) of_z -= CV(st->now + (size_t)PMR_LANES * u + n) * z[y->columns[u]];
            for (u = row[1]; u < row[2]; u++) of_v -= CV(st->now + (size_t)PMR_LANES * u + n) * v[y->columns[u]];
            V(w + PMR_LANES * k + n) = of_z + of_v;
        }
    }
}

/* z_free += share z_gain S^-1 w. */
static void push_by_terms(pmr_state *st, const pmr_scheme *c, double share)
{
    const pmr_system *y = st->system;
    int n;
    if (!y->registers) return;
    over_S(y, c, st->w, 0, y->modes, st->w_divided);
    for (n = 0; n < y->modes; n += VL) V(st->z_free + n) += CV(st->w_divided + n) * (share * c->z_gain);
}

static void push_terms(pmr_state *st, const pmr_scheme *c) { push_by_terms(st, c, 1.0); }

/* Begin a step with amplitudes (K,) at its end. */
static void expect_terms(pmr_state *st, const pmr_scheme *c, const double *amplitudes)
{
    const pmr_system *y = st->system;
    const size_t r = y->modes;
    int n;
    copy(st->z_before, st->z, y->modes);
    pmr_restart(&st->iteration);
    if (!y->registers) return;
    combine_terms(st, amplitudes);
    for (n = 0; n < y->modes; n += VL) {
        const double *old = st->old_w + n;
        V(st->w + n) = (CV(old) * 4.0 - CV(old + 3 * r)) + (CV(old + 2 * r) * 4.0 - CV(old + r) * 6.0);
    }
    push_terms(st, c);
}

/* Displacements and rates at the end of the step with the present multipliers and w. */
static void reach_end(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    double *forces = st->others, *acceleration = st->weighted, *bent = st->turned;
    int n;
    for (n = 0; n < y->modes; n += VL) V(forces + n) = CV(st->push + n) + CV(st->w + n);
    subtract_rows(st, 0, y->rows, forces);
    over_S(y, c, forces, 0, y->modes, acceleration);
    if (y->coupled) couple(st, c, st->z_next, st->v_next, bent);
    for (n = 0; n < y->modes; n += VL) {
        vec z = CV(st->z_next + n), v = CV(st->v_next + n), a = CV(acceleration + n);
        if (y->coupled)
            a += CV(bent + n);
        else
            a -= CV(c->stiffness + n) * z + CV(c->damping + n) * v;
        V(st->z + n) = z + a * c->z_gain;
        V(st->v + n) = v + a * c->v_gain;
    }
}

/* sums -= C'^T moments of pads. */
INLINE void subtract_moments(const pmr_state *st, const double *moments, double *sums)
{
    const pmr_system *y = st->system;
    int j, k, n;
    for (j = 0; j < y->pads; j++) {
        k = y->contacts + j;
        if (moments[j] == 0.0) continue;
        for (n = y->row_modes[2 * k]; n < y->row_modes[2 * k + 1]; n += VL)
            V(sums + n) -= CV(st->C + (size_t)k * y->modes + n) * moments[j];
    }
}

/* The iterate and its residual, the new w, moments and sums less the old ones: forces on the modes by w and moments;
   friction on cylinders; moments, which nothing measures by themselves. */
static void set_iterate(pmr_state *st, const double *w, const double *moments, const double *sums)
{
    const pmr_system *y = st->system;
    pmr_iteration *it = &st->iteration;
    const int r = y->modes, of_moments = it->measured;
    double *x = it->x, *f = it->f;
    int n;
    for (n = 0; n < r; n += VL) {
        V(x + n) = y->registers ? CV(w + n) : (vec){0.0};
        V(f + n) = y->registers ? CV(st->w_new + n) : (vec){0.0};
    }
    if (y->pads) {
        subtract_moments(st, moments, x);
        subtract_moments(st, st->new_moments, f);
    }
    for (n = 0; n < r; n += VL) V(f + n) -= CV(x + n);
    for (n = 0; n < y->joints; n++) {
        x[r + n] = sums[n];
        f[r + n] = st->new_sums[n] - sums[n];
    }
    for (n = 0; n < y->pads; n++) {
        x[of_moments + n] = moments[n];
        f[of_moments + n] = st->new_moments[n] - moments[n];
    }
}

/* |residual|^2 and |new forces|^2 of the modes. */
static double residual_square(const pmr_state *st, double *size)
{
    const pmr_iteration *it = &st->iteration;
    vec changes = {0.0}, sizes = {0.0};
    int n;
    for (n = 0; n < st->system->modes; n += VL) {
        vec off = CV(it->f + n), now = CV(it->x + n) + off;
        changes += off * off;
        sizes += now * now;
    }
    *size = sum_of(sizes);
    return sum_of(changes);
}

/* w, moments and sums of the next iterate. */
static void split_iterate(pmr_state *st, double *w, double *moments, double *sums)
{
    const pmr_system *y = st->system;
    pmr_iteration *it = &st->iteration;
    double *taken = it->x + it->measured;
    int n;
    copy(sums, it->x + y->modes, y->joints);
    copy(moments, taken, y->pads);
    if (!y->registers) return;
    for (n = 0; n < y->pads; n++) taken[n] = -taken[n];
    subtract_moments(st, taken, it->x);
    copy(w, it->x, y->modes);
}

/* Find w and friction anew from the multipliers: SETTLED, AGAIN where these have to follow, LAST_TIME where that
   will change nothing that counts, less than 0 where it does not converge. */
static int revise(pmr_state *st, const pmr_scheme *c, int times)
{
    const pmr_system *y = st->system;
    pmr_progress *known = &st->progress;
    const int last = times >= MOST_TIMES;
    const double bound = last ? PMR_ACCEPTED : PMR_CONVERGED;
    double change, size, largest, usual;
    int rubs = 0, foreseen, n;
    if (y->registers) {
        reach_end(st, c);
        find_terms(st, st->z, st->v, st->w_new);
    }
    if (y->pads) {
        find_friction(st, c->h);
        rubs = gaps_change(st, bound);
    }
    set_iterate(st, st->w, st->lambda + y->contacts, st->joint_sums);
    change = residual_square(st, &size);
    largest = larger(larger(known->term_largest, size), known->rub_largest);
    if (times == 1) known->term_first = size;
    usual = larger(known->term_largest, known->term_first);
    if (usual > 0.0 && change > DIVERGED * DIVERGED * usual) return -1;
    if (times == 2 && known->term_change > 0.0) {
        known->term_shrinks = larger(known->term_shrinks / 2.0, change / known->term_change);
        known->term_trusted = 0.0;
    }
    known->term_change = change;
    if ((change <= bound * bound * largest && !rubs) || change != change) { /* what is not a number is said elsewhere */
        known->term_largest = largest;
        return SETTLED;
    }
    if (last) return -1;
    extrapolate(&st->iteration);
    split_iterate(st, st->w, st->lambda + y->contacts, st->joint_sums);
    if (y->pads) set_gaps(st);
    if (y->registers) {
        for (n = 0; n < y->modes; n += VL) V(st->z_free + n) -= CV(st->w_divided + n) * c->z_gain;
        push_terms(st, c);
    }
    known->term_trusted += 1.0;
    foreseen = !rubs && known->term_shrinks > 0.0 && known->term_trusted < MOST_TRUSTED &&
               change * known->term_shrinks <= FORESEEN * PMR_CONVERGED * FORESEEN * PMR_CONVERGED * largest;
    if (foreseen) known->term_largest = largest;
    return foreseen ? LAST_TIME : AGAIN;
}

/* Forces of the present state, as if they had been so in the steps before: where a simulation or parts of another
   length begin. */
static void begin_terms(pmr_state *st, const double *amplitudes)
{
    const pmr_system *y = st->system;
    int k, n;
    for (n = 0; n < y->modes; n++) st->extra[n] = 0.0;
    if (y->pads) {
        begin_friction(st);
        subtract_moments(st, st->lambda + y->contacts, st->extra);
    }
    if (!y->registers) return;
    combine_terms(st, amplitudes);
    find_terms(st, st->z, st->v, st->w);
    for (n = 0; n < y->modes; n += VL) V(st->extra + n) += CV(st->w + n);
    for (k = 0; k < 4; k++)
        for (n = 0; n < y->modes; n += VL) V(st->old_w + (size_t)k * y->modes + n) = CV(st->w + n);
}

/* Work of terms and friction in the step, before the balance notes its end: of the forces that are neither loads nor
   contacts, and of the gaps that friction makes. */
static void account_terms(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    vec work = {0.0};
    double done;
    int n;
    for (n = 0; n < y->modes; n += VL) {
        vec extra = CV(st->others + n) - CV(st->push + n) + CV(st->pulled + n);
        work += (extra + CV(st->extra + n)) * (CV(st->z + n) - CV(st->z_before + n)) * 0.5;
        V(st->extra + n) = extra;
    }
    done = sum_of(work);
    if (y->pads) done += friction_work(st, c);
    st->energy[1] += done;
    st->energy[2] += done;
}

/* What the next step asks for. */
static void end_terms(pmr_state *st)
{
    const pmr_system *y = st->system;
    const size_t r = y->modes;
    size_t n;
    if (y->pads) end_friction(st);
    if (!y->registers) return;
    for (n = 0; n < r; n += VL) {
        double *old = st->old_w + n;
        V(old + 3 * r) = CV(old + 2 * r);
        V(old + 2 * r) = CV(old + r);
        V(old + r) = CV(old);
        V(old) = CV(st->w + n);
    }
}
