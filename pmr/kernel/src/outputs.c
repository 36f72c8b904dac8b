/* Outputs y = O z + W f - X(s) lambda, as sums of columns times their shares, and forces of all contacts. */

static void outputs(pmr_state *st, double *y_out, double *forces)
{
    const pmr_system *y = st->system;
    const double *f = st->u + y->paths;
    double *out = st->y, *shares = st->scratch;
    int k, b, p;
    if (forces) {
        for (k = 0; k < y->contacts; k++) st->entries[k] = st->lambda[k];
        for (k = 0; k < y->joints; k++) /* cylinders bear the friction of their joints too */
            if (y->joint_cylinders[k] >= 0) st->entries[y->joint_cylinders[k]] += total_friction(y, st->friction, k);
        for (k = 0; k < y->forces; k++) {
            double sum = 0.0;
            for (b = 0; b < y->contacts; b++) sum += y->shares[k * y->mp + b] * st->entries[b];
            forces[k] = sum;
        }
    }
    if (!y_out) return;
    memset(out, 0, (size_t)y->op * sizeof(double));
    add_columns(y->shapes, y->op, st->z, y->modes, out, y->op);
    add_columns(y->direct, y->op, f, y->inputs, out, y->op);
    if (!y->whole) {
        for (k = 0; k < y->rows; k++) shares[k] = -st->lambda[k];
        add_columns(y->X0, y->op, shares, y->rows, out, y->op);
    }
    for (b = 0; b < y->blocks; b++) {
        const pmr_block *block = y->block_list + b;
        const int width = PMR_UP(block->outputs), m = block->rows;
        if (!width) continue;
        for (k = 0; k < m; k++) {
            double share = -st->lambda[y->block_rows[block->at_rows + k]];
            for (p = block->powers_X - 1; p >= 0; p--) {
                shares[p * m + k] = share;
                share *= st->x[b];
            }
        }
        add_columns(in_interval(st, b, y->table_X, block->at_X, block->powers_X, m * width), width, shares,
                    block->powers_X * m, out + block->first_output, width);
    }
    copy(y_out, out, y->outputs);
}

/* Some outputs and forces, by their numbers among all outputs and, behind these, all forces. */
static void observe(pmr_state *st, int count, const int32_t *numbers, double *values)
{
    const int o = st->system->outputs;
    int moved = 0, forces = 0, k;
    for (k = 0; k < count; k++) {
        moved |= numbers[k] < o;
        forces |= numbers[k] >= o;
    }
    outputs(st, moved ? st->all : NULL, forces ? st->all + o : NULL);
    for (k = 0; k < count; k++) values[k] = st->all[numbers[k]];
}
