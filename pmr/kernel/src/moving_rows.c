/* C, H and F of the contacts that give way, with their first and second rates as the paths move: the polynomials of
   rows.c for numbers that carry their rates with them. */

static moved times_moved(moved a, moved b)
{
    return (moved){a.at * b.at, a.rate * b.at + a.at * b.rate, a.second * b.at + 2.0 * a.rate * b.rate + a.at * b.second};
}

static moved plus_moved(moved a, moved b) { return (moved){a.at + b.at, a.rate + b.rate, a.second + b.second}; }

static moved polynomial(const double *c, int powers, int stride, moved x)
{
    moved sum = {0.0, 0.0, 0.0};
    int p;
    for (p = 0; p < powers; p++) {
        sum = times_moved(sum, x);
        sum.at += c[(size_t)p * stride];
    }
    return sum;
}

static void add_moved(double *const table[3], size_t at, double factor, moved value)
{
    table[0][at] += factor * value.at;
    table[1][at] += factor * value.rate;
    table[2][at] += factor * value.second;
}

/* Entries k, l and l, k of F. */
static void add_both(const pmr_carried *ms, int k, int l, moved value)
{
    const int mp = ms->state->system->mp;
    add_moved(ms->F, (size_t)k * mp + l, k == l ? 2.0 : 1.0, value);
    if (k != l) add_moved(ms->F, (size_t)l * mp + k, 1.0, value);
}

static void move_block(const pmr_carried *ms, int number, const double *of_F, moved x)
{
    const pmr_state *st = ms->state;
    const pmr_system *y = st->system;
    const pmr_block *b = y->block_list + number;
    const int32_t *on = y->block_rows + b->at_rows, *staying = on + b->rows;
    const int m = b->rows, w = b->modes, g = PMR_UP(m), t = PMR_UP(b->stays), i = PMR_UP(b->inputs);
    const double *C = in_interval(st, number, y->table_C, b->at_C, b->powers_C, m * w),
                 *H = in_interval(st, number, y->table_H, b->at_H, b->powers_H, m * i), *S = of_F + b->powers_G * m * g;
    int k, n;
    for (k = 0; k < m; k++) {
        for (n = 0; n < w; n++)
            add_moved(ms->C, (size_t)on[k] * y->modes + b->first_mode + n, 1.0,
                      polynomial(C + k * w + n, b->powers_C, m * w, x));
        for (n = 0; n < b->inputs; n++)
            add_moved(ms->H, (size_t)on[k] * y->ip + b->first_input + n, 1.0,
                      polynomial(H + k * i + n, b->powers_H, m * i, x));
        for (n = 0; n <= k; n++) {
            moved value = polynomial(of_F + k * g + n, b->powers_G, m * g, x);
            if (n == k) value = times_moved(value, (moved){0.5, 0.0, 0.0});
            add_both(ms, on[k], on[n], value);
        }
        for (n = 0; n < b->stays; n++)
            add_both(ms, on[k], staying[n], polynomial(S + k * t + n, b->powers_S, m * t, x));
    }
}

static void move_pair(const pmr_carried *ms, int number, const double *tables, moved s, moved t)
{
    const pmr_system *y = ms->state->system;
    const pmr_block *one = y->block_list + y->pair_list[number].first,
                    *two = y->block_list + y->pair_list[number].second;
    const int p1 = one->powers_C, p2 = two->powers_C;
    int k, l, p;
    for (k = 0; k < one->rows; k++)
        for (l = 0; l < two->rows; l++) {
            const double *table = tables + (size_t)(k * two->rows + l) * p1 * p2;
            moved sum = {0.0, 0.0, 0.0};
            for (p = 0; p < p1; p++) sum = plus_moved(times_moved(sum, s), polynomial(table + p, p2, p1, t));
            add_both(ms, y->block_rows[one->at_rows + k], y->block_rows[two->at_rows + l], sum);
        }
}

/* Rows of the contacts where the paths stand at step k, with their rates as the paths move; F of those that give way is
   factorised: `failed` where these depend on each other. */
static void move_rows(pmr_carried *ms, int64_t k)
{
    pmr_state *st = ms->state;
    const pmr_system *y = st->system;
    const pmr_machine *m = ms->machine;
    const pmr_scheme *still = st->still;
    const double *motions = m->motions + (size_t)k * 3 * y->motions, *rates = m->rates + (size_t)k * y->motions,
                 *of_F = still->of_blocks, *of_pair = still->of_pairs;
    const size_t r = y->modes, i = y->ip, mp = y->mp, rows = y->rows;
    moved *at = ms->paths;
    int same = ms->past.rows_known, a, b, p;
    size_t n;
    for (p = 0; p < y->paths; p++) {
        const int32_t motion = y->frame_paths[p];
        const moved now = {motions[motion], rates[motion], motions[2 * y->motions + motion]};
        same = same && at[p].at == now.at && at[p].rate == now.rate && at[p].second == now.second;
        at[p] = now;
        st->u_begun[p] = now.at;
    }
    if (same || !y->contacts) return;
    ms->past.rows_known = 1;
    st->placed = 0;
    (void)place(st, still, st->u_begun); /* its tables; F of rigid contacts is singular */
    for (p = 0; p < 3; p++) {
        memset(ms->C[p], 0, rows * r * sizeof(double));
        memset(ms->H[p], 0, rows * i * sizeof(double));
        memset(ms->F[p], 0, rows * mp * sizeof(double));
    }
    for (n = 0; n < rows * r; n++) ms->C[0][n] = y->C0[n];
    for (n = 0; n < rows * i; n++) ms->H[0][n] = y->H0[n];
    for (a = 0; a < y->rows && !y->whole; a++)
        for (b = 0; b <= a; b++) ms->F[0][a * mp + b] = ms->F[0][b * mp + a] = y->F0[a * mp + b];
    for (p = 0; p < y->blocks; p++) {
        const pmr_block *block = y->block_list + p;
        move_block(ms, p, of_F, (moved){st->x[p], at[block->path].rate, at[block->path].second});
        of_F += block_room(block);
    }
    for (p = 0; p < y->pairs; p++) {
        const pmr_pair *pair = y->pair_list + p;
        const moved s = at[y->block_list[pair->first].path], t = at[y->block_list[pair->second].path];
        move_pair(ms, p, of_pair, (moved){st->x[pair->first], s.rate, s.second},
                  (moved){st->x[pair->second], t.rate, t.second});
        of_pair += pair_size(y->block_list + pair->first, y->block_list + pair->second);
    }
    for (p = 0; p < y->ropes; p++)
        for (n = 0; n < rows * mp; n++)
            add_moved(ms->F, n, y->rope_slopes[(size_t)p * rows * mp + n], at[y->rope_paths[p]]);
    ms->count = 0;
    for (a = 0; a < y->contacts; a++)
        if (!is_rigid(st, a)) ms->giving[ms->count++] = a;
    st->placed = 0; /* a step has another A */
    st->trouble = -1;
    ms->failed = PMR_DONE;
    for (a = 0; a < ms->count && !ms->failed; a++) {
        for (b = 0; b <= a; b++) ms->right[b] = ms->F[0][ms->giving[a] * mp + ms->giving[b]];
        if (!factorise(ms->right, ms->factor, a, (int)mp)) {
            ms->failed = PMR_DEPENDENT;
            st->trouble = ms->giving[a];
        }
    }
}
