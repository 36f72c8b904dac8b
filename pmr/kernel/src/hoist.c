/* A hoist: a rope from its winch along the boom to head sheaves, from there by n falls to a hook with its payload, a
   point p of mass m in space, along axes of the ground from the pivot.

       T = max(0, E A (l - l_0) / l_0 + eta (l - l_0)' / l_0),    l = n |h - p| + |h - w|
       m p'' = -T dl/dp + m g + wind,                             phi = -T dl/dy

   with the head h, the winch or its sheave w, and the rope's length l_0 without force.  h and w move by the displacements
   y that the loads phi of k inputs of the bodies work along,

       y = B^T z + E f - H^T lambda,    y = y_free + R phi in a step,
       R = B^T S^-1 z_gain B + E - e A^-1 e^T,    e = C S^-1 z_gain B + H

   so that T follows from one equation with dl/dy and dl/dp of the end of the step, which are found anew until they no
   longer change.  Payload and bodies are stepped by one scheme.  The damper's rate is the mean one of the part. */

#define HOIST_TIMES 60
/* Change of the rope's forces that counts as none, over the largest, and up to which one that shrinks no more is
   round-off: that of places, times the rope's stiffness. */
#define HOIST_SETTLED 1e-11
#define HOIST_CLOSE 1e-6
#define HOIST_NEAR 1e-9
#define HOIST_STILL 1e-13
#define HOIST_EXACT (8.0 * DBL_EPSILON)

/* What is known of the rope by numbers of the system, in their order (pmr/system/terms.py). */
enum {
    HOIST_MASS,
    HOIST_EA,
    HOIST_DAMPING,
    HOIST_FALLS,
    HOIST_HEAD,
    HOIST_WINCH = HOIST_HEAD + 3,
    HOIST_LEVEL = HOIST_WINCH + 3, /* the winch is on the machine, which does not luff */
    HOIST_BY_SPEED,                /* the first slot is the speed of the winch */
    HOIST_FIRST,                   /* length of the rope at the start then */
    HOIST_SWING,
    HOIST_VELOCITY = HOIST_SWING + 2,
    HOIST_HEIGHT = HOIST_VELOCITY + 3,
    HOIST_COUNT
};
/* What drives it: length or speed, wind, gravity, acceleration of the pivot, rotation of the boom, and of the direction
   that is up for the machine, which is in the boom's plane, the parts along x and z of the boom. */
enum {
    SLOT_LENGTH,
    SLOT_WIND,
    SLOT_GRAVITY = SLOT_WIND + 3,
    SLOT_SHAKEN,
    SLOT_TURNED = SLOT_SHAKEN + 3,
    SLOT_RAISED = SLOT_TURNED + 9,
    SLOT_COUNT = SLOT_RAISED + 2
};
_Static_assert((int)HOIST_COUNT == PMR_HOIST_NUMBERS && (int)SLOT_COUNT == PMR_HOIST_SLOTS, "arrays of a block");
/* Where the rope stands at the end of a part, by the numbers of `st->hoist`. */
enum {
    AT_NEXT, /* the payload's prediction: place, rate, and a */
    AT_PLACE = 9,
    AT_RATE = 12,
    AT_ACCELERATION = 15,
    AT_HEAD = 18, /* along axes of the boom */
    AT_PULL = 21, /* on the payload, along axes of the ground */
    AT_WINCH = 24, /* on the winch, along axes of the boom */
    AT_FORCE = 27,
    AT_ELASTIC, /* the force without the damper's */
    AT_LENGTH,
    AT_UNSTRETCHED,
    AT_SPEED,
    AT_COUNT
};
_Static_assert((int)AT_COUNT == PMR_HOIST_STATE, "numbers of a state");

/* A rope as it runs, along axes of the boom, and how its length grows with the places of head, winch and payload. */
typedef struct {
    double head[3], by_head[3], by_winch[3], by_payload[3], hanging, along, length;
} rope_shape;

/* Loads f (i,), of which those of the rope are those of the state. */
static const double *with_pulls(pmr_state *st, const double *f)
{
    const pmr_system *y = st->system;
    int k;
    if (!y->hoist) return f;
    copy(st->loads, f, y->inputs);
    for (k = 0; k < y->hoist; k++) st->loads[y->hoist_inputs[k]] = st->pulls[k];
    return st->loads;
}

/* Forces of the rope among the drivers of where the state stands, of which its outputs are. */
static void show_pulls(pmr_state *st)
{
    const pmr_system *y = st->system;
    int k;
    for (k = 0; k < y->hoist; k++) st->u[y->paths + y->hoist_inputs[k]] = st->pulls[k];
}

static void read_slots(const pmr_system *y, const double *u, double *slots)
{
    int k;
    for (k = 0; k < SLOT_COUNT; k++)
        slots[k] = y->hoist_shares[2 * k] + (y->hoist_slots[k] < 0 ? 0.0 : y->hoist_shares[2 * k + 1] * u[y->hoist_slots[k]]);
}

/* Acceleration of the payload without the rope, along axes of the ground. */
static void fall(const pmr_system *y, const double *slots, double *a)
{
    int k;
    for (k = 0; k < 3; k++)
        a[k] = slots[SLOT_WIND + k] / y->hoist_numbers[HOIST_MASS] - slots[SLOT_SHAKEN + k] -
               (k == 2 ? slots[SLOT_GRAVITY] : 0.0);
}

static double distance(const double *a, const double *b)
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

/* Place of the winch along axes of the boom, without extensions and displacements of a section that carries it. */
static void place_winch(const pmr_system *y, const double *slots, double *winch)
{
    copy(winch, y->hoist_numbers + HOIST_WINCH, 3);
    if (y->hoist_numbers[HOIST_LEVEL] != 0.0) {
        const double x = winch[0], z = winch[2], *raised = slots + SLOT_RAISED; /* sin phi, cos phi */
        winch[0] = x * raised[1] + z * raised[0];
        winch[2] = z * raised[1] - x * raised[0];
    }
}

/* The rope with the inputs' places displaced by `moved` (k,) and the payload at q, along axes of the boom; 1 where it
   has no direction. */
static int shape_rope(const pmr_state *st, const double *slots, const double *moved, const double *q, rope_shape *rope)
{
    const pmr_system *y = st->system;
    const double *numbers = y->hoist_numbers, falls = numbers[HOIST_FALLS];
    double winch[3];
    int k, n, p;
    copy(rope->head, numbers + HOIST_HEAD, 3);
    place_winch(y, slots, winch);
    for (p = 0; p < y->paths; p++) {
        rope->head[0] += y->hoist_reach[p] * st->s[p];
        winch[0] += y->hoist_reach[y->paths + p] * st->s[p];
    }
    for (k = 0; k < y->hoist; k++)
        for (n = 0; n < 3; n++) {
            rope->head[n] += y->hoist_levers[6 * k + n] * moved[k];
            winch[n] += y->hoist_levers[6 * k + 3 + n] * moved[k];
        }
    rope->hanging = distance(rope->head, q);
    rope->along = distance(rope->head, winch);
    rope->length = falls * rope->hanging + rope->along;
    if (!(rope->hanging > 0.0 && rope->along > 0.0)) return 1;
    for (n = 0; n < 3; n++) {
        rope->by_payload[n] = falls * (q[n] - rope->head[n]) / rope->hanging;
        rope->by_winch[n] = (winch[n] - rope->head[n]) / rope->along;
        rope->by_head[n] = -rope->by_payload[n] - rope->by_winch[n];
    }
    return 0;
}

/* dl/dy_k. */
static double by_input(const pmr_system *y, const rope_shape *rope, int k)
{
    const double *lever = y->hoist_levers + 6 * k;
    double sum = 0.0;
    int n;
    for (n = 0; n < 3; n++) sum += lever[n] * rope->by_head[n] + lever[3 + n] * rope->by_winch[n];
    return sum;
}

/* y without what flexibility by the multipliers adds, or, with a scheme's rows e, with what they take away in a step. */
static double displaced(const pmr_state *st, int k, const double *z, const double *rows)
{
    const pmr_system *y = st->system;
    const int l = y->hoist_inputs[k];
    double sum = dot(y->B + (size_t)l * y->modes, z, y->input_modes[2 * l], y->input_modes[2 * l + 1]);
    int n;
    sum += dot(y->load_energy + (size_t)l * y->ip, st->loads, 0, y->ip);
    for (n = 0; n < y->rows; n++) sum -= (rows ? rows[n] : st->H[n * y->ip + l]) * st->lambda[n];
    return sum;
}

/* S^-1 z_gain B, e, A^-1 e^T of the closed contacts and R, unless the rows stand where these are of. */
static void find_receptance(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int k, l, n;
    if (st->receptance_of == c && !y->pushing) return;
    for (k = 0; k < y->hoist; k++) {
        const int of = y->hoist_inputs[k];
        double *unit = st->hoist_units + (size_t)k * y->modes, *rows = st->hoist_rows + (size_t)k * y->mp,
               *held = st->hoist_held + (size_t)k * y->mp;
        over_S(y, c, y->B + (size_t)of * y->modes, 0, y->modes, unit);
        for (n = 0; n < y->modes; n += VL) V(unit + n) *= c->z_gain;
        for (n = 0; n < y->rows; n++)
            rows[n] = dot(st->C + (size_t)n * y->modes, unit, y->row_modes[2 * n], y->row_modes[2 * n + 1]) +
                      st->H[n * y->ip + of];
        for (n = 0; n < y->mp; n++) held[n] = 0.0;
        if (y->pushing)
            for (n = 0; n < st->factored; n++) st->entries[n] = rows[st->numbers[n]];
        else
            copy(st->entries, rows, y->contacts);
        solve(st->factor, st->factored, y->mp, st->entries);
        for (n = 0; n < st->factored; n++) held[y->pushing ? st->numbers[n] : n] = st->entries[n];
    }
    for (k = 0; k < y->hoist; k++)
        for (l = 0; l < y->hoist; l++) {
            const int of = y->hoist_inputs[k];
            double sum = dot(y->B + (size_t)of * y->modes, st->hoist_units + (size_t)l * y->modes, 0, y->modes) +
                         y->load_energy[of * y->ip + y->hoist_inputs[l]];
            for (n = 0; n < y->contacts; n++)
                sum -= st->hoist_rows[(size_t)k * y->mp + n] * st->hoist_held[(size_t)l * y->mp + n];
            st->receptance[(size_t)k * y->hoist + l] = sum;
        }
    st->receptance_of = c;
}

/* Begin a part to drivers u at its end. */
static void expect_hoist(pmr_state *st, const pmr_scheme *c, const double *u)
{
    const double *numbers = st->system->hoist_numbers;
    double *now = st->hoist, *old = st->hoist_before;
    copy(old, now, AT_COUNT);
    read_slots(st->system, u, st->slots);
    now[AT_UNSTRETCHED] = now[AT_SPEED] = st->slots[SLOT_LENGTH];
    if (numbers[HOIST_BY_SPEED] != 0.0)
        now[AT_UNSTRETCHED] = old[AT_UNSTRETCHED] - 0.5 * c->h * (old[AT_SPEED] + now[AT_SPEED]);
}

/* Forces of the rope at the end of a part, (k,) in `new_pulls`, of inputs whose places are at `free` (k,) without them.
   PMR_BLOCKED where the hook is at its sheaves. */
static int pull_rope(pmr_state *st, const pmr_scheme *c, const double *free)
{
    const pmr_system *y = st->system;
    const double *numbers = y->hoist_numbers, of_payload = c->z_gain / numbers[HOIST_MASS],
                 *old = st->hoist_before;
    double *now = st->hoist, *moved = st->hoist_moved, *slope = st->hoist_slope, *given = slope + y->hoist;
    const double unstretched = now[AT_UNSTRETCHED], elastic = numbers[HOIST_EA] / unstretched,
                 damper = numbers[HOIST_DAMPING] / unstretched / c->h,
                 longer = larger(old[AT_LENGTH] - old[AT_UNSTRETCHED], 0.0);
    double a[3], place[3], q_free[3], q[3], force = now[AT_FORCE], before = INFINITY;
    rope_shape rope;
    int times, k, l, n;
    if (!(unstretched > 0.0)) return PMR_BLOCKED;
    fall(y, st->slots, a);
    for (n = 0; n < 3; n++) place[n] = now[AT_NEXT + n] + c->z_gain * a[n];
    turn_in(st->slots + SLOT_TURNED, place, q_free);
    copy(q, q_free, 3);
    for (k = 0; k < y->hoist; k++) {
        moved[k] = free[k];
        for (l = 0; l < y->hoist; l++) moved[k] += st->receptance[(size_t)k * y->hoist + l] * st->pulls[l];
    }
    for (times = 0; times < HOIST_TIMES; times++) {
        double gives, ahead, change = 0.0;
        if (shape_rope(st, st->slots, moved, q, &rope)) return PMR_BLOCKED;
        for (k = 0; k < y->hoist; k++) slope[k] = by_input(y, &rope, k);
        gives = of_payload * dot_three(rope.by_payload, rope.by_payload);
        ahead = rope.length;
        for (k = 0; k < y->hoist; k++) {
            given[k] = 0.0;
            for (l = 0; l < y->hoist; l++) given[k] += st->receptance[(size_t)k * y->hoist + l] * slope[l];
            gives += slope[k] * given[k];
            ahead += slope[k] * (free[k] - moved[k]);
        }
        for (n = 0; n < 3; n++) ahead += rope.by_payload[n] * (q_free[n] - q[n]);
        force = ((elastic + damper) * (ahead - unstretched) - damper * longer) / (1.0 + (elastic + damper) * gives);
        if (force * gives > ahead - unstretched) force = (ahead - unstretched) / gives; /* not where it is slack */
        force = larger(force, 0.0);
        now[AT_LENGTH] = ahead - force * gives;
        for (k = 0; k < y->hoist; k++) {
            const double at = free[k] - force * given[k];
            change = larger(change, fabs(at - moved[k]));
            moved[k] = at;
        }
        for (n = 0; n < 3; n++) {
            const double at = q_free[n] - of_payload * force * rope.by_payload[n];
            change = larger(change, fabs(at - q[n]));
            q[n] = at;
        }
        if (change <= HOIST_EXACT * rope.length || (change < HOIST_NEAR * rope.length && change >= before)) break;
        before = change;
    }
    if (times == HOIST_TIMES) return PMR_BLOCKED; /* directions change that fast near the sheaves alone */
    now[AT_FORCE] = force;
    now[AT_ELASTIC] = larger(elastic * (now[AT_LENGTH] - unstretched), 0.0);
    for (k = 0; k < y->hoist; k++) st->new_pulls[k] = -force * slope[k];
    for (n = 0; n < 3; n++) q[n] = -force * rope.by_payload[n];
    turn_out(st->slots + SLOT_TURNED, q, now + AT_PULL);
    for (n = 0; n < 3; n++) now[AT_HEAD + n] = rope.head[n], now[AT_WINCH + n] = -force * rope.by_winch[n];
    return PMR_DONE;
}

/* Take the rope's forces over into what bodies and contacts are pushed by, and return their largest change over the
   largest of them. */
static double take_pulls(pmr_state *st, int follows)
{
    const pmr_system *y = st->system;
    double largest = y->hoist_numbers[HOIST_MASS] * st->slots[SLOT_GRAVITY], off = 0.0;
    int k, n;
    for (k = 0; k < y->hoist; k++) {
        const int of = y->hoist_inputs[k];
        const double change = st->new_pulls[k] - st->pulls[k], *B = y->B + (size_t)of * y->modes,
                     *unit = st->hoist_units + (size_t)k * y->modes, *rows = st->hoist_rows + (size_t)k * y->mp,
                     *held = st->hoist_held + (size_t)k * y->mp;
        largest = larger(largest, fabs(st->new_pulls[k]));
        off = larger(off, fabs(change));
        st->pulls[k] = st->loads[of] = st->new_pulls[k];
        for (n = 0; n < y->modes; n += VL) {
            V(st->push + n) += CV(B + n) * change;
            V(st->z_free + n) += CV(unit + n) * change;
        }
        for (n = 0; n < y->rows; n++) st->pushed[n] += st->H[n * y->ip + of] * change;
        if (!follows) continue;
        for (n = 0; n < y->contacts; n++) {
            st->lambda[n] += held[n] * change;
            st->excess[n] += rows[n] * change;
        }
    }
    return largest > 0.0 ? off / largest : 0.0;
}

/* The rope's forces beside the present multipliers, and their change as `take_pulls` has it. */
static int settle_rope(pmr_state *st, const pmr_scheme *c, int follows, double *change)
{
    const pmr_system *y = st->system;
    int failed, k, l;
    find_receptance(st, c);
    for (k = 0; k < y->hoist; k++) {
        st->hoist_free[k] = displaced(st, k, st->z_free, st->hoist_rows + (size_t)k * y->mp);
        for (l = 0; l < y->hoist; l++) st->hoist_free[k] -= st->receptance[(size_t)k * y->hoist + l] * st->pulls[l];
    }
    failed = pull_rope(st, c, st->hoist_free);
    if (!failed) *change = take_pulls(st, follows);
    return failed;
}

static int find_multipliers(pmr_state *st, const pmr_scheme *c);

/* Multipliers and the rope's forces at the end of a part.  Where contacts hold both ways without friction, multipliers
   follow the rope's forces as R has it; else both are found in turn. */
static int settle_hoist(pmr_state *st, const pmr_scheme *c)
{
    double change, before = INFINITY;
    int times, failed;
    if (!st->system->pads && !st->system->pushing) return find_multipliers(st, c);
    for (times = 0; times < HOIST_TIMES; times++) {
        if (times) pmr_restart(&st->iteration);
        failed = find_multipliers(st, c);
        if (!failed) failed = settle_rope(st, c, 0, &change);
        if (failed) return failed;
        if (change <= HOIST_SETTLED || (change <= HOIST_CLOSE && change >= before)) return PMR_DONE;
        before = change;
    }
    return PMR_UNCONVERGED;
}

/* The payload's prediction from where it is and its acceleration, as if that had been so before. */
static void predict_payload(pmr_state *st, const pmr_scheme *c)
{
    double *now = st->hoist;
    int n;
    for (n = 0; n < 3; n++) {
        const double a = now[AT_ACCELERATION + n];
        now[AT_NEXT + n] =
            now[AT_PLACE + n] + now[AT_RATE + n] * c->z_from_v + a * (c->z_from_force + c->z_from_share);
        now[AT_NEXT + 3 + n] = now[AT_RATE + n] + a * (c->v_from_force + c->v_from_share);
        now[AT_NEXT + 6 + n] = a * (c->a_from_force + c->a_from_share);
    }
}

/* The payload at the end of a part, and its prediction for the next. */
static void advance_payload(pmr_state *st, const pmr_scheme *c)
{
    double *now = st->hoist, a[3];
    int n;
    fall(st->system, st->slots, a);
    for (n = 0; n < 3; n++) {
        const double acceleration = a[n] + now[AT_PULL + n] / st->system->hoist_numbers[HOIST_MASS],
                     z = now[AT_NEXT + n], v = now[AT_NEXT + 3 + n], before = now[AT_NEXT + 6 + n];
        now[AT_ACCELERATION + n] = acceleration;
        now[AT_PLACE + n] = z + acceleration * c->z_gain;
        now[AT_RATE + n] = v + acceleration * c->v_gain;
        now[AT_NEXT + n] = z + v * c->z_from_v + before * c->z_from_a + acceleration * c->z_from_acceleration;
        now[AT_NEXT + 3 + n] = v + before * c->v_from_a + acceleration * c->v_from_acceleration;
        now[AT_NEXT + 6 + n] = before * c->a_from_a + acceleration * c->a_from_acceleration;
    }
}

/* Kinetic energy of the payload and elastic energy of the rope, to what is stored. */
static void store_hoist_energy(pmr_state *st)
{
    const double *numbers = st->system->hoist_numbers, *now = st->hoist;
    st->energy[0] += 0.5 * numbers[HOIST_MASS] * dot_three(now + AT_RATE, now + AT_RATE) +
                     0.5 * now[AT_ELASTIC] * now[AT_ELASTIC] * now[AT_UNSTRETCHED] / numbers[HOIST_EA];
}

/* Work of a part that the balance of the bodies has not: of what carries head and winch, against what the bodies were
   given; of gravity and wind; and of the winch, which lets the rope out with what is stored in it,

       W += mean(T) dl + mean(pull) dp + m mean(fall) dp - mean(T + T_e^2 / (2 E A)) dl_0 */
static void account_hoist(pmr_state *st)
{
    const double *numbers = st->system->hoist_numbers, *now = st->hoist, *old = st->hoist_before;
    const double let_out = now[AT_UNSTRETCHED] - old[AT_UNSTRETCHED];
    double work = 0.5 * (now[AT_FORCE] + old[AT_FORCE]) * (now[AT_LENGTH] - old[AT_LENGTH] - let_out);
    int n;
    work -= (now[AT_ELASTIC] * now[AT_ELASTIC] + old[AT_ELASTIC] * old[AT_ELASTIC]) / (4.0 * numbers[HOIST_EA]) * let_out;
    for (n = 0; n < 3; n++) /* pull and fall are the acceleration's */
        work += 0.5 * numbers[HOIST_MASS] * (now[AT_ACCELERATION + n] + old[AT_ACCELERATION + n]) *
                (now[AT_PLACE + n] - old[AT_PLACE + n]);
    st->energy[1] += work;
    store_hoist_energy(st);
}

/* Add force and moment about the pivot by which the rope pulls the displaced boom, along axes of the boom, where the state
   stands.  Between head and winch on the boom the rope pulls both, and adds nothing. */
static void add_rope_wrench(const pmr_state *st, double *force, double *moment)
{
    const double *now = st->hoist, *head = now + AT_HEAD, on_machine = st->system->hoist_numbers[HOIST_LEVEL];
    double pull[3], pulled[3];
    int n;
    turn_in(st->slots + SLOT_TURNED, now + AT_PULL, pull);
    for (n = 0; n < 3; n++) {
        pulled[n] = -pull[n] - on_machine * now[AT_WINCH + n];
        force[n] += pulled[n];
    }
    add_cross(1.0, head, pulled, moment);
}

/* Force and moment about the pivot (6,) by which the rope pulls a winch on the machine, along axes of the boom. */
static void show_winch_wrench(const pmr_state *st, double *wrench)
{
    const double *pull = st->hoist + AT_WINCH, on_machine = st->system->hoist_numbers[HOIST_LEVEL];
    double winch[3], slots[SLOT_COUNT];
    int n;
    read_slots(st->system, st->u, slots);
    place_winch(st->system, slots, winch);
    for (n = 0; n < 3; n++) wrench[n] = on_machine * pull[n];
    cross(winch, wrench, wrench + 3);
}

/* ---- start ---- */

/* Direction from head to payload at the start, along axes of the ground: by the angles of a swing, else as it hangs. */
static void hang(const pmr_state *st, const double *slots, double *way)
{
    const double *swing = st->system->hoist_numbers + HOIST_SWING, *R = slots + SLOT_TURNED;
    double a[3], size;
    int n;
    fall(st->system, slots, a);
    size = sqrt(dot_three(a, a));
    if (size > 0.0 && swing[0] == 0.0 && swing[1] == 0.0) {
        for (n = 0; n < 3; n++) way[n] = a[n] / size;
        return;
    }
    size = sqrt(R[1] * R[1] + R[4] * R[4]);
    for (n = 0; n < 2; n++) {
        const double aside = R[n ? 4 : 1] / size, ahead = (n ? -R[1] : R[4]) / size;
        way[n] = sin(swing[0]) * cos(swing[1]) * ahead + sin(swing[1]) * aside;
    }
    way[2] = -cos(swing[0]) * cos(swing[1]);
}

/* Forces of a rope that bears the payload where it stands at the start; PMR_BLOCKED where the rope is too short. */
static int begin_hoist(pmr_state *st, const double *u)
{
    const pmr_system *y = st->system;
    const double *numbers = y->hoist_numbers;
    double *now = st->hoist, *slots = st->slots, way[3], a[3], q[3], stretched, hanging;
    rope_shape rope;
    int k, n;
    read_slots(y, u, slots);
    hang(st, slots, way);
    fall(y, slots, a);
    now[AT_SPEED] = slots[SLOT_LENGTH];
    now[AT_UNSTRETCHED] = numbers[HOIST_BY_SPEED] != 0.0 ? numbers[HOIST_FIRST] : slots[SLOT_LENGTH];
    now[AT_FORCE] = now[AT_ELASTIC] = larger(numbers[HOIST_MASS] * dot_three(a, way) / numbers[HOIST_FALLS], 0.0);
    stretched = now[AT_UNSTRETCHED] * (1.0 + now[AT_FORCE] / numbers[HOIST_EA]);
    for (k = 0; k < y->hoist; k++) st->hoist_moved[k] = displaced(st, k, st->z, NULL);
    turn_in(slots + SLOT_TURNED, way, q);
    if (shape_rope(st, slots, st->hoist_moved, q, &rope) && !(rope.along > 0.0)) return PMR_BLOCKED;
    hanging = (stretched - rope.along) / numbers[HOIST_FALLS];
    if (!(hanging > 0.0)) return PMR_BLOCKED;
    for (n = 0; n < 3; n++) q[n] = rope.head[n] + hanging * q[n];
    if (shape_rope(st, slots, st->hoist_moved, q, &rope)) return PMR_BLOCKED;
    turn_out(slots + SLOT_TURNED, q, now + AT_PLACE);
    copy(now + AT_HEAD, rope.head, 3);
    copy(now + AT_RATE, numbers + HOIST_VELOCITY, 3);
    now[AT_LENGTH] = stretched;
    for (n = 0; n < 3; n++) {
        now[AT_PULL + n] = -now[AT_FORCE] * numbers[HOIST_FALLS] * way[n];
        now[AT_WINCH + n] = -now[AT_FORCE] * rope.by_winch[n];
        now[AT_ACCELERATION + n] = a[n] + now[AT_PULL + n] / numbers[HOIST_MASS];
    }
    for (k = 0; k < y->hoist; k++) st->new_pulls[k] = -now[AT_FORCE] * by_input(y, &rope, k);
    return PMR_DONE;
}

/* ---- outputs ---- */

/* Height of the hook and its place in m, swing along and across the boom's plane in rad, force of the rope in N, and its
   pull on the winch along axes of the ground. */
static void show_hoist(pmr_state *st, double *shown)
{
    const pmr_system *y = st->system;
    const double *now = st->hoist, *R;
    double slots[SLOT_COUNT], head[3], way[3], size, ahead, aside;
    int n;
    read_slots(y, st->u, slots);
    R = slots + SLOT_TURNED;
    turn_out(slots + SLOT_TURNED, now + AT_HEAD, head);
    for (n = 0; n < 3; n++) way[n] = now[AT_PLACE + n] - head[n];
    size = sqrt(R[1] * R[1] + R[4] * R[4]);
    ahead = (way[0] * R[4] - way[1] * R[1]) / size;
    aside = (way[0] * R[1] + way[1] * R[4]) / size;
    shown[0] = now[AT_PLACE + 2] + y->hoist_numbers[HOIST_HEIGHT];
    copy(shown + 1, now + AT_PLACE, 3);
    shown[4] = atan2(ahead, -way[2]);
    shown[5] = atan2(aside, sqrt(ahead * ahead + way[2] * way[2]));
    shown[6] = now[AT_FORCE];
    turn_out(slots + SLOT_TURNED, now + AT_WINCH, shown + 7);
}
