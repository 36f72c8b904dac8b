/* A system: what stands where in its block of bytes, and whether that is sound. */
#include "internal.h"
#include "law.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <stddef.h>
#include <string.h>

/* Whether `count` integers lie in low <= value < high. */
static int within(const int32_t *values, int64_t count, int32_t low, int32_t high)
{
    int64_t n;
    for (n = 0; n < count; n++)
        if (values[n] < low || values[n] >= high) return 0;
    return 1;
}

static int ascends(const int32_t *values, int64_t count, int32_t last)
{
    int64_t n;
    if (values[0] != 0 || values[count - 1] != last) return 0;
    for (n = 1; n < count; n++)
        if (values[n] < values[n - 1]) return 0;
    return 1;
}

/* Whether a table of a block lies within all tables of its kind. */
static int lies(const pmr_system *y, const char *name, int32_t at, const pmr_block *block, int32_t powers,
                int32_t width)
{
    const int64_t need = (int64_t)block->intervals * powers * block->rows * width;
    return at >= 0 && at % PMR_LANES == 0 && powers > 0 && powers <= 16 && at + need <= pmr_block_count(y, name);
}

static int check_block(pmr_system *y, const pmr_block *b, char *why)
{
    const int32_t m = b->rows;
    int64_t size;
    int32_t k;
    if (b->path < 0 || b->path >= y->paths || b->body < 0 || b->body > y->modes || b->intervals < 1 || m < 1 ||
        m > y->rows || b->stays < 0 || b->stays > y->rows || b->first_mode < 0 || b->first_mode % PMR_LANES ||
        b->modes < 0 || b->modes % PMR_LANES || b->first_mode + b->modes > y->modes || b->first_input < 0 ||
        b->inputs < 0 || b->first_input + b->inputs > y->inputs || b->first_output < 0 || b->outputs < 0 ||
        b->first_output + PMR_UP(b->outputs) > y->op || b->at_breaks < 0 ||
        b->at_breaks + b->intervals + 1 > pmr_block_count(y, "breaks") || b->at_rows < 0 ||
        (int64_t)b->at_rows + m + b->stays > pmr_block_count(y, "block_rows"))
        return pmr_say(why, "damaged: sizes of a block"), 1;
    if (!lies(y, "table_C", b->at_C, b, b->powers_C, b->modes) ||
        !lies(y, "table_G", b->at_G, b, b->powers_G, PMR_UP(m)) ||
        !lies(y, "table_S", b->at_S, b, b->powers_S, PMR_UP(b->stays)) ||
        !lies(y, "table_H", b->at_H, b, b->powers_H, PMR_UP(b->inputs)) ||
        !lies(y, "table_X", b->at_X, b, b->powers_X, PMR_UP(b->outputs)) || b->powers_G < 2 * b->powers_C - 1 ||
        b->powers_S < b->powers_C)
        return pmr_say(why, "damaged: tables of a block"), 1;
    for (k = 0; k < b->intervals; k++)
        if (!(y->breaks[b->at_breaks + k] < y->breaks[b->at_breaks + k + 1]))
            return pmr_say(why, "damaged: breaks of a block"), 1;
    if (!within(y->block_rows + b->at_rows, m + b->stays, 0, y->rows))
        return pmr_say(why, "damaged: rows of a block"), 1;
    for (k = 0; k < m; k++) {
        const int32_t *modes = y->row_modes + 2 * y->block_rows[b->at_rows + k];
        if (modes[0] > b->first_mode || modes[1] < b->first_mode + b->modes)
            return pmr_say(why, "damaged: modes of a row"), 1;
    }
    if (b->width) {
        const int64_t count = (int64_t)b->intervals * m * b->width;
        if (b->width < 0 || b->carriers < 1 || b->at_touched < 0 ||
            b->at_touched + count > pmr_block_count(y, "touched") || b->at_weights < 0 ||
            b->at_weights + count * b->powers_C > pmr_block_count(y, "weights") ||
            !within(y->touched + b->at_touched, count, 0, b->carriers))
            return pmr_say(why, "damaged: carriers of a block"), 1;
    }
    size = (int64_t)m * (b->powers_G * PMR_UP(m) + b->powers_S * PMR_UP(b->stays));
    if (size > INT32_MAX / 2) return pmr_say(why, "damaged: a block is too large"), 1;
    size = (int64_t)m * (b->powers_C + b->powers_X) *
           (b->modes + PMR_UP(m) + PMR_UP(b->stays) + PMR_UP(b->inputs) + PMR_LANES);
    if (size > y->largest_table) y->largest_table = (int32_t)size;
    return 0;
}

/* Whether a block's table of reactions lies within all of them. */
static int check_reactions(pmr_system *y, int number, char *why)
{
    const pmr_block *b = y->block_list + number;
    const int32_t *of = y->reaction_blocks + 4 * number;
    const int64_t room = (int64_t)b->rows * of[2] + 64;
    if (of[0] < 0 || of[1] < 0 || of[1] > y->hp || of[0] + PMR_UP(of[1]) > y->hp ||
        !lies(y, "table_R", of[3], b, of[2], PMR_UP(of[1])))
        return pmr_say(why, "damaged: reactions of a block"), 1;
    if (room > y->largest_table) y->largest_table = (int32_t)room;
    return 0;
}

static int check_pair(pmr_system *y, const pmr_pair *pair, char *why)
{
    const pmr_block *one, *two;
    if (pair->first < 0 || pair->second < 0 || pair->first >= y->blocks || pair->second >= y->blocks ||
        pair->first == pair->second)
        return pmr_say(why, "damaged: a pair of blocks"), 1;
    one = y->block_list + pair->first;
    two = y->block_list + pair->second;
    if (one->body != two->body || one->first_mode != two->first_mode || one->modes != two->modes || one->width < 1 ||
        two->width < 1 || pair->at_between < 0 ||
        pair->at_between + (int64_t)one->carriers * two->carriers > pmr_block_count(y, "between"))
        return pmr_say(why, "damaged: carriers of a pair of blocks"), 1;
    return 0;
}

/* Whether the quantities of a frame are made of what there is. */
static int check_frame(const pmr_system *y, char *why)
{
    int32_t k;
    if (!y->motions) return 0;
    if (!within(y->frame_angles, 5, -1, y->motions) || !within(y->frame_paths, y->paths, 0, y->motions) ||
        !within(y->products, 3 * (int64_t)y->product_count, 0, y->quantities) ||
        !ascends(y->first_product, y->drivers - y->paths + 1, y->product_count))
        return pmr_say(why, "damaged: products of a frame"), 1;
    for (k = 0; k < y->quantities; k++) {
        const int32_t kind = y->quantity_list[3 * k], *of = y->quantity_list + 3 * k + 1;
        const int axes = kind == PMR_TURNED || kind == PMR_VELOCITY || kind == PMR_TURNING || kind == PMR_GRADIENT ||
                         kind == PMR_RAISED;
        if (kind < PMR_ONE || kind > PMR_RAISED || of[0] < 0 || of[1] < 0 || (axes && (of[0] > 2 || of[1] > 2)) ||
            (kind == PMR_MOTION && of[0] >= y->motions) || (kind == PMR_REACH && (of[0] > y->motions || of[1] > 2)) ||
            (kind == PMR_OVER && (of[0] < 1 || of[0] > y->motions)))
            return pmr_say(why, "damaged: quantities of a frame"), 1;
    }
    return 0;
}

#define TAKE(field, kind, count)                                                                                       \
    if (!(y->field = pmr_block_take(y, #field, kind, count, why))) return 1

static int read_blocks(pmr_system *y, char *why)
{
    if (!(y->block_list = pmr_block_take(y, "blocks", PMR_INTEGERS, (int64_t)y->blocks * PMR_BLOCK_NUMBERS, why)))
        return 1;
    return !(y->pair_list = pmr_block_take(y, "pairs", PMR_INTEGERS, -1, why));
}

/* Reactions of supports, the tip and the cylinder that raises the boom. */
static int read_further(pmr_system *y, char *why)
{
    const int32_t *sizes = pmr_block_take(y, "further", PMR_INTEGERS, 3, why);
    const int64_t values = pmr_block_count(y, "support_values");
    int64_t sources;
    int k;
    if (!sizes) return 1;
    if (sizes[0] < 0 || sizes[0] > 1 << 20 || sizes[2] < 0 || sizes[2] > 1 || sizes[1] < 0 || sizes[1] > 1 ||
        ((sizes[1] || sizes[2]) && !y->motions))
        return pmr_say(why, "damaged: sizes of further outputs"), 1;
    y->reactions = sizes[0], y->has_tip = sizes[1], y->has_cylinder = sizes[2];
    y->hp = PMR_UP(y->reactions) + PMR_LANES;
    sources = (int64_t)y->outputs + y->reactions + y->forces;
    TAKE(reaction_shapes, PMR_NUMBERS, (int64_t)y->modes * y->hp);
    TAKE(reaction_rates, PMR_NUMBERS, (int64_t)y->modes * y->hp);
    TAKE(reaction_direct, PMR_NUMBERS, (int64_t)y->inputs * y->hp);
    TAKE(reaction_X0, PMR_NUMBERS, (int64_t)y->rows * y->hp);
    TAKE(table_R, PMR_NUMBERS, -1);
    TAKE(reaction_blocks, PMR_INTEGERS, 4 * (int64_t)y->blocks);
    TAKE(support_first, PMR_INTEGERS, y->terms + 1);
    TAKE(support_entries, PMR_INTEGERS, 2 * values);
    TAKE(support_values, PMR_NUMBERS, values);
    TAKE(tip_numbers, PMR_INTEGERS, y->has_tip ? 4 : 0);
    TAKE(tip_place, PMR_NUMBERS, y->has_tip ? 3 : 0);
    TAKE(cylinder_hinges, PMR_NUMBERS, y->has_tip ? 4 : 0);
    y->pressing = (int32_t)pmr_block_count(y, "pressing_numbers");
    TAKE(pressing_numbers, PMR_INTEGERS, y->pressing);
    TAKE(pressing_wrenches, PMR_NUMBERS, 6 * (int64_t)y->pressing * (1 + y->paths));
    TAKE(cylinder_pin, PMR_INTEGERS, y->has_cylinder ? 3 : 0);
    if (!ascends(y->support_first, y->terms + 1, (int32_t)values) ||
        !within(y->pressing_numbers, y->pressing, 0, (int32_t)sources))
        return pmr_say(why, "damaged: supports or cylinder"), 1;
    for (k = 0; k < values; k++)
        if (!within(y->support_entries + 2 * k, 1, 0, y->reactions) ||
            !within(y->support_entries + 2 * k + 1, 1, 0, 2 * y->modes))
            return pmr_say(why, "damaged: terms of supports"), 1;
    if (y->has_tip && (!within(y->tip_numbers, 3, -1, y->outputs) || !within(y->tip_numbers + 3, 1, 0, y->motions + 1)))
        return pmr_say(why, "damaged: the tip"), 1;
    if (y->has_cylinder && (!y->has_tip || !within(y->cylinder_pin, 2, -1, y->reactions) ||
                            !within(y->cylinder_pin + 2, 1, 0, (int32_t)sources) || y->frame_angles[0] < 0))
        return pmr_say(why, "damaged: the cylinder's pin"), 1;
    return 0;
}

/* Outriggers, and what presses on them. */
static int read_ground(pmr_system *y, char *why)
{
    const int64_t count = pmr_block_count(y, "ground_stand"), forces = (int64_t)y->outputs + y->reactions + y->forces;
    pmr_stand *s = &y->stand;
    const double *numbers;
    if (!count || count > 1 << 20) return count ? (pmr_say(why, "damaged: outriggers"), 1) : 0;
    s->corners = (int32_t)pmr_block_count(y, "ground_corners");
    s->outriggers = (int32_t)((count - 1 - 6 * (int64_t)s->corners) / 3);
    y->ground_mass_count = (int32_t)(pmr_block_count(y, "ground_masses") / 8);
    TAKE(ground_numbers, PMR_INTEGERS, 5);
    TAKE(ground_masses, PMR_NUMBERS, 8 * (int64_t)y->ground_mass_count);
    s->at_corners = pmr_block_take(y, "ground_corners", PMR_INTEGERS, s->corners, why);
    numbers = pmr_block_take(y, "ground_stand", PMR_NUMBERS,
                             1 + 3 * (int64_t)s->outriggers + 6 * (int64_t)s->corners, why);
    if (!s->at_corners || !numbers) return 1;
    if (!y->has_tip || s->outriggers < 3 || s->outriggers > PMR_MOST_OUTRIGGERS || s->corners < 3 ||
        s->corners > s->outriggers || !within(s->at_corners, s->corners, 0, s->outriggers) ||
        !within(y->ground_numbers, 4, -1, y->motions) || !within(y->ground_numbers + 4, 1, -1, (int32_t)forces))
        return pmr_say(why, "damaged: outriggers"), 1;
    s->height = numbers[0];
    s->places = numbers + 1, s->stiffness = s->places + 2 * s->outriggers;
    s->edges = s->stiffness + s->outriggers;
    y->ground = 7 + s->outriggers + s->corners;
    y->ground_reads_outputs = !within(y->pressing_numbers, y->pressing, y->outputs, (int32_t)forces) ||
                              (y->ground_numbers[4] >= 0 && y->ground_numbers[4] < y->outputs);
    return 0;
}

/* A hoist and what it is driven by, behind the amplitudes of terms. */
static int read_hoist(pmr_system *y, char *why)
{
    if (pmr_block_count(y, "hoist_inputs") > y->inputs) return pmr_say(why, "damaged: inputs of a hoist"), 1;
    y->hoist = (int32_t)pmr_block_count(y, "hoist_inputs");
    TAKE(hoist_inputs, PMR_INTEGERS, y->hoist);
    TAKE(hoist_slots, PMR_INTEGERS, y->hoist ? PMR_HOIST_SLOTS : 0);
    TAKE(hoist_shares, PMR_NUMBERS, y->hoist ? 2 * PMR_HOIST_SLOTS : 0);
    TAKE(hoist_levers, PMR_NUMBERS, 6 * (int64_t)y->hoist);
    TAKE(hoist_numbers, PMR_NUMBERS, y->hoist ? PMR_HOIST_NUMBERS : 0);
    TAKE(hoist_reach, PMR_NUMBERS, y->hoist ? 2 * (int64_t)y->paths : 0);
    if (!within(y->hoist_inputs, y->hoist, 0, y->inputs) ||
        !within(y->hoist_slots, y->hoist ? PMR_HOIST_SLOTS : 0, -1, y->drivers) ||
        (!y->hoist && y->drivers != y->paths + y->inputs + y->terms))
        return pmr_say(why, "damaged: inputs or drivers of a hoist"), 1;
    return 0;
}

/* Numbers of a cylinder, in their order in the header. */
enum { ACTUATOR = (sizeof(pmr_actuator) - offsetof(pmr_actuator, foot)) / sizeof(double) };

/* A free extension: sections that move with it, and its cylinder. */
static int read_extension(pmr_system *y, char *why)
{
    enum { INTEGERS = 3, EACH = 4 };
    pmr_extension *e = &y->extension;
    const int32_t *integers;
    const double *numbers;
    int k;
    e->drive = -1;
    if (!pmr_block_count(y, "extension_integers")) return 0;
    if (!(integers = pmr_block_take(y, "extension_integers", PMR_INTEGERS, -1, why))) return 1;
    e->sections = integers[2];
    if (e->sections < 1 || e->sections > y->paths || pmr_block_count(y, "extension_integers") != INTEGERS + EACH * e->sections)
        return pmr_say(why, "damaged: sizes of a free extension"), 1;
    if (!(numbers = pmr_block_take(y, "extension_numbers", PMR_NUMBERS, 2 + ACTUATOR + 2 * (int64_t)e->sections, why))) return 1;
    e->drive = integers[0], e->cylinder.kind = integers[1], e->moved = integers + INTEGERS, e->ratios = numbers + 2 + ACTUATOR;
    memcpy(e->range, numbers, sizeof e->range);
    memcpy(&e->cylinder.foot, numbers + 2, ACTUATOR * sizeof(double));
    for (k = 0; k < e->sections; k++)
        if (!within(e->moved + EACH * k, 1, 0, y->motions) || !within(e->moved + EACH * k + 1, 1, 0, y->paths) ||
            !within(e->moved + EACH * k + 2, 1, 0, y->contacts) || !within(e->moved + EACH * k + 3, 1, -1, y->joints))
            return pmr_say(why, "damaged: numbers of a free extension"), 1;
    if (!within(&e->drive, 1, -1, y->motions) || e->cylinder.kind < PMR_CYLINDER_FORCE || e->cylinder.kind > PMR_CYLINDER_OIL ||
        y->computed)
        return pmr_say(why, "damaged: numbers of a free extension"), 1;
    y->computed = (e->cylinder.kind == PMR_CYLINDER_OIL ? PMR_CYLINDER_COLUMNS : 3) + 1;
    return 0;
}

/* A free luffing angle: the boom's moments and its cylinder. */
static int read_luffing(pmr_system *y, char *why)
{
    enum { INTEGERS = 9, NUMBERS = 14 + ACTUATOR };
    pmr_machine *m = &y->boom;
    pmr_actuator *c = &m->cylinder;
    const int64_t r = y->modes;
    const int32_t *integers;
    const double *numbers;
    int32_t k;
    y->luffing_gravity = y->luffing_drive = -1;
    if (!pmr_block_count(y, "luffing_integers")) return 0;
    integers = pmr_block_take(y, "luffing_integers", PMR_INTEGERS, INTEGERS, why);
    numbers = pmr_block_take(y, "luffing_numbers", PMR_NUMBERS, NUMBERS, why);
    if (!integers || !numbers) return 1;
    m->sections = integers[0], m->shortened_count = integers[1], m->inertial_count = integers[2];
    for (k = 0; k < 3; k++) m->axes[k] = integers[3 + k];
    y->luffing_gravity = integers[6], y->luffing_drive = integers[7];
    c->kind = integers[8];
    if (m->sections < 1 || m->sections > 1 << 10 || m->shortened_count < 0 || m->shortened_count > 1 << 10 ||
        m->inertial_count < 0 || m->inertial_count > y->inputs || !within(integers + 3, 5, -1, y->motions) ||
        c->kind < PMR_NO_CYLINDER || c->kind > PMR_CYLINDER_OIL)
        return pmr_say(why, "damaged: sizes of a free luffing angle"), 1;
    y->computed = c->kind == PMR_CYLINDER_OIL ? 2 + PMR_CYLINDER_COLUMNS : c->kind ? 5 : 2;
    m->free[4] = m->luffs = 1;
    m->level = numbers[0], m->boom_mass = numbers[1];
    memcpy(m->place, numbers + 2, sizeof m->place);
    memcpy(m->section_inertia, numbers + 5, sizeof m->section_inertia);
    memcpy(&c->foot, numbers + 14, (NUMBERS - 14) * sizeof(double)); /* in their order in the header */
#define MOMENT(name, kind, count) if (!(m->name = pmr_block_take(y, "luffing_" #name, kind, count, why))) return 1
    MOMENT(section_paths, PMR_INTEGERS, m->sections);
    MOMENT(fields, PMR_INTEGERS, 12 * (int64_t)m->sections);
    MOMENT(inertial, PMR_INTEGERS, m->inertial_count);
    MOMENT(masses, PMR_NUMBERS, m->sections);
    MOMENT(first_moments, PMR_NUMBERS, 3 * (int64_t)m->sections);
    MOMENT(loads, PMR_NUMBERS, 6 * (int64_t)m->sections * y->inputs);
    MOMENT(rotating, PMR_NUMBERS, 3 * r * r);
    MOMENT(second_moments, PMR_NUMBERS, 9 * r * r);
    MOMENT(of_shortened, PMR_INTEGERS, 3 * (int64_t)m->shortened_count);
    MOMENT(shortened, PMR_NUMBERS, m->shortened_count * r * r);
#undef MOMENT
    if (!within(m->section_paths, m->sections, -1, y->motions) || !within(m->fields, 12 * (int64_t)m->sections, -1, y->inputs) ||
        !within(m->inertial, m->inertial_count, 0, y->inputs))
        return pmr_say(why, "damaged: numbers of a free luffing angle"), 1;
    for (k = 0; k < m->shortened_count; k++)
        if (!within(m->of_shortened + 3 * k, 1, 0, m->sections) || !within(m->of_shortened + 3 * k + 1, 1, 0, 4) ||
            !within(m->of_shortened + 3 * k + 2, 1, -1, m->sections))
            return pmr_say(why, "damaged: moments of a free luffing angle"), 1;
    return 0;
}

static int read_arrays(pmr_system *y, char *why)
{
    static const char *const names[] = {"modes",   "rows",  "contacts", "forces", "inputs",
                                        "outputs", "paths", "terms",    "pads",   "joints",
                                        "drivers", "whole", "coupled",  "ropes",  "motions"};
    int32_t *const to[] = {&y->modes,   &y->rows,  &y->contacts, &y->forces, &y->inputs,
                           &y->outputs, &y->paths, &y->terms,    &y->pads,   &y->joints,
                           &y->drivers, &y->whole, &y->coupled,  &y->ropes,  &y->motions};
    enum { SIZES = sizeof names / sizeof *names };
    const int32_t *sizes = pmr_block_take(y, "sizes", PMR_INTEGERS, SIZES, why);
    const int64_t most = 1 << 20;
    int64_t r, m, i;
    int32_t k;
    if (!sizes) return 1;
    for (k = 0; k < SIZES; k++) {
        if (sizes[k] < 0 || sizes[k] > most) return pmr_say(why, "damaged: %s = %d", names[k], sizes[k]), 1;
        *to[k] = sizes[k];
    }
    if (y->modes % PMR_LANES || y->rows != y->contacts + y->pads || y->drivers < y->paths + y->inputs + y->terms ||
        y->whole > 1 || y->coupled > 1)
        return pmr_say(why, "damaged: sizes"), 1;
    r = y->modes, m = y->rows, i = y->inputs;
    y->mp = PMR_UP(y->rows);
    y->ip = PMR_UP(y->inputs);
    y->op = PMR_UP(y->outputs) + PMR_LANES; /* a body's outputs are filled up beyond those of the last one */
    y->blocks = (int32_t)(pmr_block_count(y, "blocks") / PMR_BLOCK_NUMBERS);
    if (pmr_block_count(y, "blocks") % PMR_BLOCK_NUMBERS || pmr_block_count(y, "pairs") % PMR_PAIR_NUMBERS)
        return pmr_say(why, "damaged: blocks or pairs"), 1;
    y->pairs = (int32_t)(pmr_block_count(y, "pairs") / PMR_PAIR_NUMBERS);
    y->quasi_static = (int32_t)pmr_block_count(y, "of_modes");
    y->registers = (int32_t)pmr_block_count(y, "columns");
    y->entries = (int32_t)pmr_block_count(y, "registers_of");
    TAKE(omega2, PMR_NUMBERS, r);
    TAKE(damping, PMR_NUMBERS, y->coupled ? r * r : r);
    TAKE(inertia, PMR_NUMBERS, r);
    TAKE(B, PMR_NUMBERS, i * r);
    TAKE(shapes, PMR_NUMBERS, r * y->op);
    TAKE(direct, PMR_NUMBERS, i * y->op);
    TAKE(load_energy, PMR_NUMBERS, i * y->ip);
    TAKE(clearance, PMR_NUMBERS, m);
    TAKE(pushes, PMR_INTEGERS, m);
    TAKE(row_modes, PMR_INTEGERS, 2 * m);
    TAKE(path_ends, PMR_NUMBERS, 2 * y->paths);
    TAKE(breaks, PMR_NUMBERS, -1);
    TAKE(block_rows, PMR_INTEGERS, -1);
    TAKE(table_C, PMR_NUMBERS, -1);
    TAKE(table_G, PMR_NUMBERS, -1);
    TAKE(table_S, PMR_NUMBERS, -1);
    TAKE(table_H, PMR_NUMBERS, -1);
    TAKE(table_X, PMR_NUMBERS, -1);
    TAKE(C0, PMR_NUMBERS, m * r);
    TAKE(F0, PMR_NUMBERS, m * y->mp);
    TAKE(H0, PMR_NUMBERS, m * y->ip);
    TAKE(X0, PMR_NUMBERS, m * y->op);
    TAKE(touched, PMR_INTEGERS, -1);
    TAKE(weights, PMR_NUMBERS, -1);
    TAKE(between, PMR_NUMBERS, -1);
    TAKE(rope_paths, PMR_INTEGERS, y->ropes);
    TAKE(rope_slopes, PMR_NUMBERS, y->ropes * m * y->mp);
    TAKE(shares, PMR_NUMBERS, (int64_t)y->forces * y->mp);
    TAKE(of_modes, PMR_INTEGERS, -1);
    TAKE(of_rows, PMR_INTEGERS, y->registers ? 3 * (r / PMR_LANES) : 0);
    TAKE(columns, PMR_INTEGERS, y->registers);
    TAKE(first_entry, PMR_INTEGERS, y->terms + 1);
    TAKE(registers_of, PMR_INTEGERS, y->entries);
    TAKE(entry_values, PMR_NUMBERS, (int64_t)PMR_LANES * y->entries);
    TAKE(joint_paths, PMR_INTEGERS, y->joints);
    TAKE(joint_cylinders, PMR_INTEGERS, y->joints);
    TAKE(joint_gives, PMR_NUMBERS, y->joints);
    TAKE(first_pad, PMR_INTEGERS, y->joints + 1);
    TAKE(pad_contacts, PMR_INTEGERS, y->pads);
    TAKE(pad_laws, PMR_NUMBERS, LAW_CONSTANTS * y->pads);
    TAKE(pad_stiffness, PMR_NUMBERS, y->pads);
    TAKE(pad_arms, PMR_NUMBERS, y->pads);
    y->quantities = (int32_t)(pmr_block_count(y, "quantity_list") / 3);
    y->product_count = (int32_t)pmr_block_count(y, "factors");
    TAKE(frame_angles, PMR_INTEGERS, y->motions ? 5 : 0);
    TAKE(frame_paths, PMR_INTEGERS, y->motions ? y->paths : 0);
    TAKE(quantity_list, PMR_INTEGERS, 3 * (int64_t)y->quantities);
    TAKE(products, PMR_INTEGERS, 3 * (int64_t)y->product_count);
    TAKE(factors, PMR_NUMBERS, y->product_count);
    TAKE(first_product, PMR_INTEGERS, y->motions ? y->drivers - y->paths + 1 : 0);
    return read_further(y, why) || read_ground(y, why) || read_hoist(y, why) || read_luffing(y, why) || read_extension(y, why) ||
           read_blocks(y, why);
}
#undef TAKE

static int check_arrays(pmr_system *y, char *why)
{
    int32_t k;
    if (!within(y->pushes, y->rows, 0, 2) || !within(y->row_modes, 2 * (int64_t)y->rows, 0, y->modes + 1) ||
        !within(y->rope_paths, y->ropes, 0, y->paths) || !within(y->of_modes, y->quasi_static, 0, y->modes) ||
        !within(y->columns, y->registers, 0, y->modes) || !within(y->registers_of, y->entries, 0, y->registers) ||
        !ascends(y->first_entry, y->terms + 1, y->entries) || !within(y->joint_paths, y->joints, 0, y->paths) ||
        !within(y->joint_cylinders, y->joints, -1, y->contacts) || !ascends(y->first_pad, y->joints + 1, y->pads) ||
        !within(y->pad_contacts, y->pads, 0, y->contacts))
        return pmr_say(why, "damaged: numbers beyond their range"), 1;
    for (k = 0; k < y->rows; k++) {
        if (y->row_modes[2 * k] % PMR_LANES || y->row_modes[2 * k + 1] % PMR_LANES)
            return pmr_say(why, "damaged: modes of a row"), 1;
        if (k < y->contacts)
            y->pushing += y->pushes[k];
        else if (y->pushes[k])
            return pmr_say(why, "damaged: a moment that pushes"), 1;
    }
    for (k = 0; k < (y->registers ? y->modes / PMR_LANES : 0); k++) {
        const int32_t *row = y->of_rows + 3 * k;
        if (row[0] < 0 || row[0] > row[1] || row[1] > row[2] || row[2] > y->registers)
            return pmr_say(why, "damaged: rows of terms"), 1;
    }
    if (check_frame(y, why)) return 1;
    for (k = 0; k < y->blocks; k++)
        if (check_block(y, y->block_list + k, why) || check_reactions(y, k, why)) return 1;
    for (k = 0; k < y->pairs; k++)
        if (check_pair(y, y->pair_list + k, why)) return 1;
    if (y->whole) {
        const pmr_block *b = y->block_list;
        if (y->blocks != 1 || y->pairs || b->rows != y->rows || b->stays || b->modes != y->modes ||
            b->inputs != y->inputs || y->ropes || y->pads)
            return pmr_say(why, "damaged: one block with all rows"), 1;
        for (k = 0; k < y->rows; k++)
            if (y->block_rows[b->at_rows + k] != k) return pmr_say(why, "damaged: one block with all rows"), 1;
    }
    return 0;
}

/* Which of `count` columns (count, width) have entries among `outputs` outputs. */
static void find_span(const double *columns, int32_t count, int32_t width, int32_t outputs, int32_t *span)
{
    int32_t k, n;
    span[0] = span[1] = 0;
    for (k = 0; k < count; k++)
        for (n = 0; n < outputs; n++)
            if (columns[(int64_t)k * width + n] != 0.0) {
                if (!span[1]) span[0] = k;
                span[1] = k + 1;
            }
}

static int find_spans(const pmr_system *y, pmr_observed *set)
{
    const int32_t width = set->width;
    int32_t n;
    set->spans = malloc(6 * sizeof(int32_t) * (width / PMR_SPAN + 1));
    for (n = 0; set->spans && n < width; n += PMR_SPAN) {
        int32_t *span = set->spans + 6 * (n / PMR_SPAN), outputs = width - n < PMR_SPAN ? width - n : PMR_SPAN;
        find_span(set->shapes + n, y->modes, width, outputs, span);
        find_span(set->direct + n, y->inputs, width, outputs, span + 2);
        find_span(set->X0 + n, y->rows, width, outputs, span + 4);
    }
    return !set->spans;
}

/* Which loads touch which modes, and by how much modes give way. */
static int find_touched(pmr_system *y)
{
    double stiffest = 0.0;
    int32_t k;
    y->input_modes = malloc(2 * sizeof(int32_t) * (y->inputs + 1));
    y->mode_inputs = malloc(2 * sizeof(int32_t) * (y->modes / PMR_LANES + 1));
    y->give = malloc(sizeof(double) * (y->modes + 1));
    if (!y->input_modes || !y->mode_inputs || !y->give) return 1;
    for (k = 0; k < y->modes; k++) stiffest = fmax(stiffest, y->omega2[k]);
    for (k = 0; k < y->modes; k++) y->give[k] = y->omega2[k] > RIGID_MOTION * stiffest ? 1.0 / y->omega2[k] : 0.0;
    for (k = 0; k < y->inputs; k++) {
        int32_t *touched = y->input_modes + 2 * k;
        find_span(y->B + (size_t)k * y->modes, y->modes, 1, 1, touched);
        touched[0] = touched[0] / PMR_LANES * PMR_LANES, touched[1] = PMR_UP(touched[1]);
    }
    for (k = 0; k < y->modes / PMR_LANES; k++)
        find_span(y->B + PMR_LANES * k, y->inputs, y->modes, PMR_LANES, y->mode_inputs + 2 * k);
    return 0;
}

int pmr_system_open(const void *block, size_t bytes, pmr_system **system, char *why)
{
    pmr_system *y = calloc(1, sizeof *y);
    *system = NULL;
    if (!y) return pmr_say(why, "no memory"), PMR_NO_MEMORY;
    y->block = block;
    y->bytes = bytes;
    if (pmr_block_check(y, why) || read_arrays(y, why) || check_arrays(y, why)) {
        free(y);
        return PMR_REFUSED;
    }
    y->observed[0] = (pmr_observed){y->op, 0, y->shapes, y->direct, y->X0, y->table_X, NULL};
    y->observed[1] = (pmr_observed){y->hp, 1, y->reaction_shapes, y->reaction_direct, y->reaction_X0, y->table_R, NULL};
    if (find_spans(y, y->observed) || find_spans(y, y->observed + 1) || find_touched(y)) {
        pmr_system_close(y);
        return pmr_say(why, "no memory"), PMR_NO_MEMORY;
    }
    y->checksum = pmr_block_checksum(y);
    *system = y;
    return PMR_DONE;
}

void pmr_system_close(pmr_system *system)
{
    int k;
    if (!system) return;
    for (k = 0; k < 2; k++) free(system->observed[k].spans);
    free(system->input_modes);
    free(system->mode_inputs);
    free(system->give);
    free(system);
}

void pmr_system_sizes(const pmr_system *y, pmr_sizes *sizes)
{
    const pmr_sizes found = {.modes = y->modes,
                             .contacts = y->contacts,
                             .forces = y->forces,
                             .inputs = y->inputs,
                             .outputs = y->outputs,
                             .paths = y->paths,
                             .terms = y->terms,
                             .pads = y->pads,
                             .drivers = y->drivers,
                             .motions = y->motions,
                             .pushing = y->pushing,
                             .further = y->reactions + 3 * y->has_tip + y->has_cylinder + y->ground +
                                        (y->hoist ? PMR_HOIST_OUTPUTS : 0) + y->computed,
                             .hoist = y->hoist ? PMR_HOIST_OUTPUTS : 0,
                             .computed = y->computed,
                             .ground = y->ground};
    *sizes = found;
}

const char *pmr_system_names(const pmr_system *y, const char *list, size_t *count)
{
    char name[40];
    const char *text;
    snprintf(name, sizeof name, "names_%s", list);
    text = pmr_block_take(y, name, PMR_BYTES, -1, NULL);
    *count = text ? (size_t)pmr_block_count(y, name) : 0;
    return text;
}

const double *pmr_system_numbers(const pmr_system *y, const char *name, int64_t *count)
{
    *count = pmr_block_count(y, name);
    return pmr_block_take(y, name, PMR_NUMBERS, -1, NULL);
}

const int32_t *pmr_system_integers(const pmr_system *y, const char *name, int64_t *count)
{
    *count = pmr_block_count(y, name);
    return pmr_block_take(y, name, PMR_INTEGERS, -1, NULL);
}
