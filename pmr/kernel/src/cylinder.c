/* A cylinder of length L that pushes with the force F.  It drives a free extension, which L is, or the luffing angle phi,
   from the foot r_0 on the machine to the lug r_1 on the boom, with L = |R(phi) r_1 - r_0| and the moment F dL/dphi.

   Driven by a length it pushes with F_0 + k (l - l_0 - L + L_0).  Oil pushes with p_1 A_1 - p_2 A_2.  The volumes of
   bore and rod side are V_1 = V_01 + A_1 (L - L_min) and V_2 = V_02 + A_2 (L_max - L), and with the bulk modulus K

       V_i p_i' / K + V_i' = Q_i

   under the flows Q_i into the chambers.  A step of h from 0 to 1 ends where

       (V_0 + V_1) / 2 (p_1 - p_0) / K + V_1 - V_0 = h Q~_1,    Q~_1 = (2 Q_1 + Q~_0) / 3.

   What is swept is exact, so shut oil is a spring without losses; flows follow backward differences of second order
   (Q~_0 is the last step's), which damp what is faster than the step. */

enum { MOST_PRESSURES = 200 };
/* Share of a chamber's dead volume that trials leave at least of it; no step ends there. */
#define LEAST_CHAMBER 1e-3
#define PRESSURE_ROUND_OFF 1e-14

/* A flow, and how it grows with the pressures of both chambers. */
typedef struct {
    double at, by[2];
} flow;

/* Flow through an edge of gain g under a pressure drop, g p / (p^2 + laminar^2)^(1/4), and how it grows with the drop. */
static double through_edge(double g, double drop, double laminar, double *slope)
{
    const double square = drop * drop + laminar * laminar, root = sqrt(sqrt(square));
    *slope = g * (1.0 - 0.5 * drop * drop / square) / root;
    return g * drop / root;
}

/* Flow into chamber i from its edge of the valve, at an effective opening; `fed` is by the supply. */
static flow through_valve(const pmr_actuator *c, double opening, int i, const double *p, int *fed)
{
    const double open = fabs(opening), source = (*fed = (opening > 0.0) == (i == 0)) ? c->supply : c->tank;
    double gain = open * c->gain[i], slope, change;
    flow q = {0.0, {0.0, 0.0}};
    if (open == 0.0) {
        *fed = 0;
        return q;
    }
    if (i == 0 && c->counterbalance > 0.0 && p[0] > source) { /* out of the bore: both valves in series */
        const double lift = (p[0] + c->ratio * p[1] - c->setting) / c->range;
        const double valve = c->counterbalance * (lift < 0.0 ? 0.0 : lift > 1.0 ? 1.0 : lift);
        const double both = sqrt(gain * gain + valve * valve), series = gain * valve / both;
        q.at = through_edge(series, source - p[0], c->laminar, &slope);
        q.by[0] = -slope;
        if (lift > 0.0 && lift < 1.0) {
            change = gain * gain * gain / (both * both * both) * c->counterbalance / c->range;
            change *= through_edge(1.0, source - p[0], c->laminar, &slope);
            q.by[0] += change;
            q.by[1] += c->ratio * change;
        }
        return q;
    }
    q.at = through_edge(gain, source - p[i], c->laminar, &slope);
    q.by[i] = -slope;
    return q;
}

/* Flows into both chambers at an opening of the valve, and out of the supply.  The spool of a valve has stops: beyond -1
   or 1 it stays fully open. */
static void find_flows(const pmr_actuator *c, double opening, const double *p, flow q[2], double *supplied)
{
    const double beyond = (fabs(opening) > 1.0 ? 1.0 : fabs(opening)) - c->dead_band;
    const double effective = beyond > 0.0 ? copysign(beyond / (1.0 - c->dead_band), opening) : 0.0;
    int i, fed;
    *supplied = 0.0;
    for (i = 0; i < 2; i++) {
        q[i] = through_valve(c, effective, i, p, &fed);
        if (fed) *supplied = q[i].at;
    }
    for (i = 0; i < 2; i++) {
        q[i].at += c->leakage * (p[1 - i] - p[i]);
        q[i].by[i] -= c->leakage;
        q[i].by[1 - i] += c->leakage;
    }
}

static double chamber(const pmr_actuator *c, int i, double length)
{
    return c->volumes[i] + c->areas[i] * (i ? c->stroke[1] - length : length - c->stroke[0]);
}

/* What the chambers' pressures p leave of the law of a step of h, in Pa, and its derivative. */
static void find_chambers_left(const pmr_actuator *c, double h, double opening, const cylinder_state *old,
                               cylinder_state *now, double left[2], double slope[4])
{
    flow q[2];
    int i, j;
    find_flows(c, opening, now->pressures, q, &now->supplied);
    for (i = 0; i < 2; i++) {
        const double before = chamber(c, i, old->length), after = chamber(c, i, now->length);
        const double stiffness = 2.0 * c->bulk_modulus / larger(before + after, LEAST_CHAMBER * c->volumes[i]);
        now->flows[i] = q[i].at;
        now->mean[i] = (2.0 * q[i].at + old->mean[i]) / 3.0;
        left[i] = now->pressures[i] - old->pressures[i] + stiffness * (after - before - h * now->mean[i]);
        for (j = 0; j < 2; j++) slope[2 * i + j] = (i == j) - stiffness * h * 2.0 / 3.0 * q[i].by[j];
    }
}

/* Where something that grows becomes zero lies between two bounds; `before` is the size of what was left at the last
   place tried, INFINITY before the first. */
typedef struct {
    double low, high, before;
} bracket;

/* The place to try after `at`, where `left` is left: `ahead`, or the middle of the bounds where `ahead` is beyond them or
   `at` has not halved what is left; `at` itself where no number is between the bounds. */
static double keep_between(bracket *b, double at, double left, double ahead)
{
    const int slow = fabs(left) > b->before / 2.0;
    double middle;
    b->before = fabs(left);
    if (left < 0.0)
        b->low = larger(b->low, at);
    else
        b->high = at < b->high ? at : b->high;
    if (ahead > b->low && ahead < b->high && !(slow && b->high - b->low < INFINITY)) return ahead;
    middle = (b->low + b->high) / 2.0;
    return middle > b->low && middle < b->high ? middle : at;
}

/* A better pressure by Newton's method; whether it stays as it is. */
static int improve_pressure(bracket *b, double *p, double left, double slope, double scale)
{
    const double at = *p, ahead = at - left / slope;
    if (fabs(ahead - at) <= PRESSURE_ROUND_OFF * scale) return 1;
    *p = keep_between(b, at, left, ahead);
    return *p == at;
}

/* Pressures at the end of a step of h; NAN where there are none.  What is left of the bore grows with the bore's
   pressure, and what is left of the rod side with its own while the bore's follows, so both have bounds. */
static void find_pressures(const pmr_actuator *c, double h, double opening, const cylinder_state *old,
                           cylinder_state *now)
{
    bracket rod = {-INFINITY, INFINITY, INFINITY}, bore;
    double left[2], slope[4], *p = now->pressures, scale;
    int outer, inner;
    copy(p, old->pressures, 2);
    for (outer = 0; outer < MOST_PRESSURES; outer++) {
        bore = (bracket){-INFINITY, INFINITY, INFINITY};
        for (inner = 0; inner < MOST_PRESSURES; inner++) {
            find_chambers_left(c, h, opening, old, now, left, slope);
            scale = larger(larger(fabs(p[0]), fabs(p[1])), larger(c->supply, 1.0));
            if (improve_pressure(&bore, p, left[0], slope[0], scale)) break;
        }
        if (inner == MOST_PRESSURES) break;
        if (improve_pressure(&rod, p + 1, left[1], slope[3] - slope[2] * slope[1] / slope[0], scale)) return;
    }
    p[0] = p[1] = NAN;
}

/* Force of the stops, which only push back, k d (1 + c d') where one is pressed in by d (Hunt and Crossley 1975): of a
   cylinder that is too short above 0. */
static double push_of_stops(const pmr_actuator *c, double length, double speed)
{
    const double below = c->stroke[0] - length, above = length - c->stroke[1];
    if (below > 0.0) return c->stop_stiffness * below * larger(1.0 - c->stop_damping * speed, 0.0);
    return above > 0.0 ? -c->stop_stiffness * above * larger(1.0 + c->stop_damping * speed, 0.0) : 0.0;
}

/* Friction of a cylinder that got longer by `moved` in a step of h: the law of a pad (law.h) with limits in N. */
_Static_assert(sizeof(((pmr_actuator *)0)->friction) == LAW_CONSTANTS * sizeof(double), "all constants of the law");
static double rub_cylinder(const pmr_actuator *c, double old, double moved, double h)
{
    const double limit = friction_limit(c->friction, 1.0, fabs(moved) / h, NULL);
    double f = 0.0;
    if (limit > 0.0) (void)slide(1, &c->shear_stiffness, &old, &limit, moved, 0.0, 0.0, &f);
    return f;
}

/* Force of a cylinder of such a length and speed at the end of a step of h after `old`, or at the start where this is
   NULL, under its drive and the drive's rate; `loaded` is what it begins with: the force of a length's spring, and
   pressures. */
static void find_push(const pmr_actuator *c, double h, const double drive[2], const double loaded[3],
                      const cylinder_state *old, cylinder_state *now)
{
    const double length = now->length;
    flow q[2];
    int i;
    now->emptied = 0;
    now->force = c->damping * ((c->kind == PMR_CYLINDER_LENGTH ? drive[1] : 0.0) - now->speed);
    now->force += push_of_stops(c, length, now->speed);
    now->friction = old ? rub_cylinder(c, old->friction, length - old->length, h) : 0.0;
    now->force -= now->friction;
    if (c->kind == PMR_CYLINDER_FORCE) now->force += drive[0];
    now->begun = old ? old->begun : drive[0] - length;
    now->held = old ? old->held : loaded[0];
    if (c->kind == PMR_CYLINDER_LENGTH) now->force += now->held + c->spring * (drive[0] - length - now->begun);
    if (c->kind != PMR_CYLINDER_OIL) return;
    if (old) {
        if (chamber(c, 0, length) <= 0.0 || chamber(c, 1, length) <= 0.0) now->emptied = 1;
        find_pressures(c, h, drive[0], old, now);
        for (i = 0; i < 2; i++) now->fed[i] = old->fed[i] + h * now->mean[i];
    } else {
        copy(now->pressures, loaded + 1, 2);
        find_flows(c, drive[0], now->pressures, q, &now->supplied);
        for (i = 0; i < 2; i++) now->flows[i] = now->mean[i] = q[i].at, now->fed[i] = 0.0;
    }
    now->force += now->pressures[0] * c->areas[0] - now->pressures[1] * c->areas[1];
}

/* What a cylinder begins with that holds with such a force. */
static void load_by_force(const pmr_actuator *c, double force, double loaded[3])
{
    double *pressures = loaded + 1;
    loaded[0] = pressures[0] = pressures[1] = 0.0;
    if (c->kind != PMR_CYLINDER_OIL) {
        loaded[0] = force;
        return;
    }
    pressures[0] = (force + c->back_pressure * c->areas[1]) / c->areas[0];
    pressures[1] = c->back_pressure;
    if (pressures[0] < 0.0) {
        pressures[0] = c->back_pressure;
        pressures[1] = (c->back_pressure * c->areas[0] - force) / c->areas[1];
    }
}

/* Length of the cylinder at a luffing angle, and by how much it grows for each radian. */
static double length_at(const pmr_actuator *c, double angle, double *arm)
{
    number length, direction[2];
    *arm = cylinder_line(c->foot, c->lug, constant(angle), &length, direction).at;
    return length.at;
}

/* Add the cylinder's share to the machine's forces by its directions, at step k with the machine's motion b. */
static void push_by_cylinder(pmr_machine_run *ms, int64_t k, const double *b, double *springs)
{
    const pmr_actuator *c = &ms->machine->cylinder;
    cylinder_state *now = &ms->now.cylinder;
    double arm;
    now->length = length_at(c, ms->machine->level - b[4], &arm);
    now->speed = -arm * b[10];
    find_push(c, ms->state->settings.step, ms->machine->drive + 2 * (size_t)k, ms->loaded, k ? &ms->past.cylinder : NULL,
              now);
    springs[4] -= arm * now->force;
}
