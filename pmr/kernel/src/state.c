/* A state: one block of memory, its layout, and how it is saved.

   Saved are a head, the progress and the numbers up to `saved`, all of what the next step depends on; the rows are
   placed anew when they are restored, so that a restored state goes on bit for bit. */

typedef struct {
    char magic[8];
    uint64_t system, settings, checksum; /* of the system's bytes, of the settings, of the bytes behind this head */
    int64_t bytes;
    char zeros[24];
} state_head;

/* Room in a block of memory: without one it is only counted. */
typedef struct {
    char *memory;
    size_t at;
} room;

static void *take_room(room *r, size_t count, size_t size)
{
    void *memory = r->memory ? r->memory + r->at : NULL;
    r->at += (count * size + PMR_LINE - 1) / PMR_LINE * PMR_LINE;
    return memory;
}

#define NUMBERS(field, count) st->field = take_room(r, (size_t)(count), sizeof(double))
#define INTEGERS(field, count) st->field = take_room(r, (size_t)(count), sizeof(int32_t))

static void lay_out_scheme(const pmr_system *y, pmr_scheme *c, room *r)
{
    pmr_scheme unused, *st = c ? c : &unused;
    size_t k, blocks = 0, pairs = 0;
    for (k = 0; k < (size_t)y->blocks; k++) blocks += block_room(y->block_list + k);
    for (k = 0; k < (size_t)y->pairs; k++)
        pairs += pair_size(y->block_list + y->pair_list[k].first, y->block_list + y->pair_list[k].second);
    NUMBERS(stiffness, y->modes);
    NUMBERS(damping, y->modes);
    NUMBERS(unit, y->modes);
    NUMBERS(inverse, y->coupled ? (size_t)y->modes * y->modes : 0);
    NUMBERS(F0, y->rows * y->mp);
    NUMBERS(of_blocks, blocks);
    INTEGERS(in_blocks, y->blocks);
    NUMBERS(of_pairs, pairs);
    INTEGERS(in_pairs, 2 * y->pairs);
}

/* Iterates of forces of terms, of friction on cylinders and of its moments, each filled up. */
static void lay_out_iteration(const pmr_system *y, pmr_state *st, room *r)
{
    pmr_iteration *it = &st->iteration;
    const int varies = y->registers || y->pads;
    size_t count;
    it->measured = varies ? y->modes + PMR_UP(y->joints) : 0;
    it->count = varies ? it->measured + PMR_UP(y->pads) : 0;
    count = it->count;
    it->most = MOST_PAIRS;
    it->sum = NULL;
    NUMBERS(iteration.x, count);
    NUMBERS(iteration.f, count);
    NUMBERS(iteration.least_x, count);
    NUMBERS(iteration.least_f, count);
    NUMBERS(iteration.directions, MOST_PAIRS * count);
    NUMBERS(iteration.changes, MOST_PAIRS * count);
}

/* Doubles of `scratch`: of any table's values, of a body's modes, of what outputs take. */
static size_t scratch_size(const pmr_system *y)
{
    size_t size = (size_t)y->largest_table + y->mp + y->modes + 64;
    const size_t held = (size_t)y->modes + y->rows;
    if (y->coupled && size < (size_t)y->modes * y->modes) size = (size_t)y->modes * y->modes;
    if (size < 2 * held * (held + 1)) size = 2 * held * (held + 1); /* of the equilibrium at the start */
    return size;
}

static size_t pair_width(const pmr_system *y)
{
    size_t size = 0;
    int k;
    for (k = 0; k < y->pairs; k++) {
        const size_t of_pair =
            (size_t)y->block_list[y->pair_list[k].first].powers_C * y->block_list[y->pair_list[k].second].width;
        if (of_pair > size) size = of_pair;
    }
    return size;
}

static void lay_out_luffing(const pmr_system *y, pmr_state *st, room *r);
static int can_carry(const pmr_system *y, const pmr_settings *settings, const pmr_machine *machine);

/* Numbers that the next step of a free extension, or of a luffing angle, depends on. */
static size_t past_size(const pmr_system *y)
{
    if (y->extension.sections) return (sizeof(extension_past) + 7) / sizeof(double);
    return y->computed ? (sizeof(machine_past) + 7) / sizeof(double) + 2 * (size_t)y->boom.inertial_count : 0;
}

static size_t end_size(const pmr_system *y, const pmr_state *st, const pmr_machine *machine);

static void lay_out(const pmr_system *y, pmr_state *st, int levels, room *r)
{
    const size_t n = y->modes, m = y->rows, mp = y->mp;
    size_t first, size_of_end;
    int k;
    int32_t *parts;
    take_room(r, 1, sizeof *st);
    parts = take_room(r, levels, sizeof(int32_t));
    if (r->memory) st->settings.parts = parts;
    first = r->at;
    NUMBERS(mark, 0);
    NUMBERS(z_next, n);
    NUMBERS(v_next, n);
    NUMBERS(a_next, n);
    NUMBERS(z_free, n);
    NUMBERS(z, n);
    NUMBERS(v, n);
    NUMBERS(lambda, mp);
    NUMBERS(force, mp);
    NUMBERS(share, mp);
    NUMBERS(closed, mp);
    NUMBERS(impulse, mp);
    NUMBERS(energy, 4);
    NUMBERS(old_friction, y->pads);
    NUMBERS(old_gap, mp);
    NUMBERS(drives, y->joints);
    NUMBERS(travelled, y->joints);
    NUMBERS(hoist, y->hoist ? PMR_HOIST_STATE : 0);
    NUMBERS(pulls, y->hoist);
    NUMBERS(motions, 4 * y->motions);
    NUMBERS(computed, y->computed);
    NUMBERS(computed_past, past_size(y));
    st->marked = (r->at - first) / sizeof(double);
    NUMBERS(w, n);
    NUMBERS(old_w, 4 * n);
    NUMBERS(extra, n);
    NUMBERS(accelerated, n);
    NUMBERS(friction, y->pads);
    NUMBERS(gap, mp);
    NUMBERS(joint_sums, y->joints);
    NUMBERS(u, y->drivers);
    st->stepped = (r->at - first) / sizeof(double);
    size_of_end = y->computed && !y->extension.sections ? end_size(y, st, &y->boom) : 0;
    NUMBERS(answer, size_of_end);
    NUMBERS(answer_drift, size_of_end);
    st->saved = (r->at - first) / sizeof(double);
    NUMBERS(began, st->saved);
    NUMBERS(peak, mp);
    NUMBERS(s, y->paths);
    NUMBERS(s_rates, y->paths);
    NUMBERS(x, y->blocks);
    st->moved_paths = take_room(r, y->paths, sizeof(moved));
    INTEGERS(interval, y->blocks);
    NUMBERS(C, m * n);
    NUMBERS(H, m * y->ip);
    NUMBERS(A, m * mp);
    NUMBERS(factor, m * mp);
    NUMBERS(weighted, n);
    NUMBERS(excess, mp);
    NUMBERS(entries, mp);
    NUMBERS(motion, mp);
    NUMBERS(pushed, mp);
    NUMBERS(push, n);
    NUMBERS(pulled, n);
    NUMBERS(turned, n);
    NUMBERS(others, n);
    NUMBERS(scratch, scratch_size(y));
    NUMBERS(loads, y->ip);
    NUMBERS(known_amplitudes, y->terms);
    NUMBERS(now, PMR_LANES * (size_t)y->registers);
    INTEGERS(numbers, mp);
    INTEGERS(wrong, mp);
    NUMBERS(old_z, n);
    NUMBERS(old_push, n);
    NUMBERS(old_C, m * n);
    NUMBERS(old_A, m * mp);
    NUMBERS(old_H, m * y->ip);
    NUMBERS(old_loads, y->ip);
    NUMBERS(old_lambda, mp);
    NUMBERS(acceleration, n);
    NUMBERS(before_closed, mp);
    NUMBERS(before_lambda, mp);
    NUMBERS(w_new, n);
    NUMBERS(w_divided, n);
    NUMBERS(z_before, n);
    NUMBERS(limits, y->pads);
    NUMBERS(new_moments, y->pads);
    NUMBERS(along, y->pads);
    NUMBERS(new_sums, y->joints);
    lay_out_iteration(y, st, r);
    NUMBERS(pair_sums, pair_width(y));
    NUMBERS(u_next, y->drivers);
    NUMBERS(u_begun, y->drivers);
    NUMBERS(motions_next, 4 * y->motions);
    NUMBERS(motions_now, 3 * y->motions);
    NUMBERS(quantities, 2 * y->quantities);
    NUMBERS(values, y->op + y->hp + y->forces + 6 + PMR_HOIST_OUTPUTS + y->computed);
    NUMBERS(changes, y->op + y->hp + y->forces);
    NUMBERS(shown, y->reactions + 4 + y->ground);
    NUMBERS(kept, y->extension.sections ? st->saved : 0);
    NUMBERS(hoist_before, PMR_HOIST_STATE);
    NUMBERS(slots, PMR_HOIST_SLOTS);
    NUMBERS(new_pulls, y->hoist);
    NUMBERS(receptance, (size_t)y->hoist * y->hoist);
    NUMBERS(hoist_units, y->hoist * n);
    NUMBERS(hoist_rows, y->hoist * mp);
    NUMBERS(hoist_held, y->hoist * mp);
    NUMBERS(hoist_free, y->hoist);
    NUMBERS(hoist_moved, y->hoist);
    NUMBERS(hoist_slope, 2 * y->hoist);
    NUMBERS(held, 3 * (n + mp));
    NUMBERS(slopes, y->paths * m * (n + y->ip + mp));
    NUMBERS(seeds, 10 * n + y->drivers + y->joints);
    st->scheme = take_room(r, (size_t)levels + 1, sizeof(pmr_scheme));
    for (k = 0; k <= levels; k++) lay_out_scheme(y, r->memory ? st->scheme + k : NULL, r);
    st->still = st->scheme + levels;
    if (y->computed && !y->extension.sections) lay_out_luffing(y, st, r);
}

/* A scheme without a step: A is F. */
static void set_still(const pmr_system *y, pmr_scheme *c)
{
    int n;
    for (n = 0; n < y->modes; n++) c->unit[n] = 1.0;
    memcpy(c->F0, y->F0, (size_t)y->rows * y->mp * sizeof(double));
}

static void forget_tables(const pmr_system *y, pmr_scheme *c)
{
    int k;
    for (k = 0; k < y->blocks; k++) c->in_blocks[k] = -1;
    for (k = 0; k < 2 * y->pairs; k++) c->in_pairs[k] = -1;
}

static int check_settings(const pmr_settings *given, char *why)
{
    int k;
    if (!(given->step > 0.0 && isfinite(given->step)))
        return pmr_say(why, "step = %g: more than 0 s is allowed", given->step), 1;
    if (!(given->rho_inf >= 0.0 && given->rho_inf <= 1.0))
        return pmr_say(why, "rho_inf = %g: 0 to 1 is allowed", given->rho_inf), 1;
    if (!(given->contact_omega >= 0.0 && isfinite(given->contact_omega)))
        return pmr_say(why, "contact_omega = %g: 0 rad/s or more is allowed", given->contact_omega), 1;
    if (given->contact_omega > 0.0 && !(given->tolerance > 0.0 && isfinite(given->tolerance)))
        return pmr_say(why, "tolerance = %g: more than 0 is allowed", given->tolerance), 1;
    if (given->levels < 1 || given->levels > PMR_MOST_LEVELS)
        return pmr_say(why, "levels = %d: 1 to %d are allowed", given->levels, PMR_MOST_LEVELS), 1;
    if (!given->parts && given->levels > 1) return pmr_say(why, "parts of %d levels are missing", given->levels), 1;
    for (k = 0; given->parts && k < given->levels; k++)
        if (given->parts[k] < 1 || given->parts[k] > 1 << 20 || (k && given->parts[k] <= given->parts[k - 1]))
            return pmr_say(why, "parts: ascending numbers from 1 on are allowed"), 1;
    return 0;
}

/* Take other settings, which are sound, into a state with room for their levels. */
static int take_settings(pmr_state *st, const pmr_settings *given, char *why)
{
    const pmr_system *y = st->system;
    int32_t *parts = (int32_t *)st->settings.parts;
    int k;
    st->settings = *given;
    st->settings.parts = parts;
    for (k = 0; k < given->levels; k++) parts[k] = given->parts ? given->parts[k] : 1;
    for (k = 0; k < given->levels; k++) {
        if (set_scheme(y, st->scheme + k, given->step / parts[k], given->rho_inf, st->scratch))
            return pmr_say(why, "damping that couples modes makes the step singular"), PMR_REFUSED;
        forget_tables(y, st->scheme + k);
    }
    st->progress.active = st->progress.came = -1;
    if (st->progress.level >= given->levels) st->progress.level = given->levels - 1;
    return PMR_DONE;
}

/* Learn the answer to the luffing angle's rate (machine.c) anew: a step failed, or its length or rho changed. */
static void forget_answer(pmr_state *st) { ((machine_past *)(void *)st->computed_past)->answers = 0; }

static int state_adjust(pmr_state *st, const pmr_settings *given, char *why)
{
    if (check_settings(given, why)) return PMR_REFUSED;
    if (given->levels > st->opened)
        return pmr_say(why, "levels = %d: there is room for %d", given->levels, st->opened), PMR_REFUSED;
    st->placed = 0;
    if (st->run && (given->step != st->settings.step || given->rho_inf != st->settings.rho_inf)) forget_answer(st);
    return take_settings(st, given, why);
}

static int state_open(const pmr_system *y, const pmr_settings *given, pmr_state **state, char *why)
{
    pmr_state counted = {0}, *st;
    room r = {NULL, 0};
    int k;
    *state = NULL;
    if (check_settings(given, why)) return PMR_REFUSED;
    if (y->extension.sections && given->energy)
        return pmr_say(why, "a free extension is stepped without energy"), PMR_REFUSED;
    if (y->computed && !y->extension.sections && !can_carry(y, given, &y->boom))
        return pmr_say(why, "a free luffing angle is stepped with contacts that hold, without parts and energy"), PMR_REFUSED;
    counted.system = y;
    lay_out(y, &counted, given->levels, &r);
    r.memory = pmr_aligned(r.at);
    if (!r.memory) return pmr_say(why, "no memory for a state of %zu bytes", r.at), PMR_NO_MEMORY;
    memset(r.memory, 0, r.at);
    st = (pmr_state *)r.memory;
    st->system = y;
    st->memory = r.at;
    st->opened = given->levels;
    r.at = 0;
    lay_out(y, st, given->levels, &r);
    for (k = 0; k < y->terms; k++) st->known_amplitudes[k] = NAN;
    if (take_settings(st, given, why)) {
        pmr_free_aligned(st);
        return PMR_REFUSED;
    }
    set_still(y, st->still);
    forget_tables(y, st->still);
    st->trouble = -1;
    *state = st;
    return PMR_DONE;
}

/* ---- saved states ---- */

static uint64_t settings_sum(const pmr_state *st)
{
    const pmr_settings *s = &st->settings;
    const double numbers[] = {s->step, s->rho_inf, s->contact_omega, s->tolerance, s->levels, s->energy};
    return pmr_checksum(numbers, sizeof numbers) ^ pmr_checksum(s->parts, (size_t)s->levels * sizeof(int32_t));
}

static size_t state_bytes(const pmr_state *st)
{
    return sizeof(state_head) + sizeof(pmr_progress) + st->saved * sizeof(double);
}

static void state_save(const pmr_state *st, void *bytes)
{
    char *at = bytes;
    state_head head = {.system = st->system->checksum, .settings = settings_sum(st), .bytes = (int64_t)state_bytes(st)};
    memcpy(head.magic, "PMRSTAT3", 8);
    memcpy(at + sizeof head, &st->progress, sizeof st->progress);
    memcpy(at + sizeof head + sizeof st->progress, st->mark, st->saved * sizeof(double));
    head.checksum = pmr_checksum(at + sizeof head, (size_t)head.bytes - sizeof head);
    memcpy(at, &head, sizeof head);
}

/* Loads, energies and rows of where a state stands. */
static int stand(pmr_state *st)
{
    const int level = st->progress.active < 0 ? 0 : st->progress.active;
    int failed;
    st->placed = 0;
    st->moved = 1;
    failed = place(st, st->scheme + level, st->u);
    if (failed) return failed;
    load_bodies(st, st->u + st->system->paths);
    find_load_energy(st);
    keep_end(st);
    return PMR_DONE;
}

/* Put a state back where it was, as `began` and `progress` have it, and return what has failed. */
static int return_to(pmr_state *st, const pmr_progress *progress, int failed)
{
    const int trouble = st->trouble;
    int failed_back;
    memcpy(st->mark, st->began, st->saved * sizeof(double));
    st->progress = *progress;
    st->factored = -1;
    failed_back = stand(st);
    st->trouble = trouble;
    return failed ? failed : failed_back;
}

static int state_restore(pmr_state *st, const void *bytes, size_t count, char *why)
{
    const char *at = bytes;
    state_head head;
    pmr_progress progress;
    size_t n;
    if (count < sizeof head) return pmr_say(why, "no state: %zu bytes", count), PMR_REFUSED;
    memcpy(&head, at, sizeof head);
    if (memcmp(head.magic, "PMRSTAT3", 8))
        return pmr_say(why, "no state that this kernel can read (PMRSTAT3)"), PMR_REFUSED;
    if (head.system != st->system->checksum) return pmr_say(why, "a state of another system"), PMR_REFUSED;
    if (head.settings != settings_sum(st)) return pmr_say(why, "a state with other settings"), PMR_REFUSED;
    if (head.bytes != (int64_t)count || count != state_bytes(st))
        return pmr_say(why, "cut short: %zu of %zu bytes", count, state_bytes(st)), PMR_REFUSED;
    if (head.checksum != pmr_checksum(at + sizeof head, count - sizeof head))
        return pmr_say(why, "damaged: the checksum differs"), PMR_REFUSED;
    memcpy(&progress, at + sizeof head, sizeof progress);
    if (progress.step < 0 || progress.level < 0 || progress.level >= st->settings.levels || progress.active < -1 ||
        progress.active >= st->settings.levels || progress.came < -1 || progress.came >= st->settings.levels ||
        progress.parts < 0)
        return pmr_say(why, "damaged: where the state stands"), PMR_REFUSED;
    for (n = 0; n < st->saved; n++) {
        double value;
        memcpy(&value, at + sizeof head + sizeof progress + n * sizeof value, sizeof value);
        if (!isfinite(value)) return pmr_say(why, "damaged: what is no finite number"), PMR_REFUSED;
    }
    st->progress = progress;
    memcpy(st->mark, at + sizeof head + sizeof progress, st->saved * sizeof(double));
    return stand(st);
}
