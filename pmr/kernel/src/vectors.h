/* Registers of PMR_VL doubles by GCC's and Clang's vector extensions, or plain doubles with PMR_VL = 1.

   They may alias doubles, of which they are made, and nothing else: so pointers of a state stay in registers. */
#ifndef PMR_VECTORS_H
#define PMR_VECTORS_H

#if PMR_VL > 1
typedef double vec __attribute__((vector_size(8 * PMR_VL)));
/* of memory of others, which NumPy aligns to 16 bytes */
typedef double loose_vec __attribute__((vector_size(8 * PMR_VL), aligned(8)));
#else
typedef double vec;
typedef double loose_vec;
#endif
#define V(p) (*(vec *)(p))
#define CV(p) (*(const vec *)(p))
#define LOOSE(p) (*(loose_vec *)(p))
#define CONST_LOOSE(p) (*(const loose_vec *)(p))
#define VL PMR_VL

/* Few numbers that have just been stored one by one are read one by one: a register of them would wait for the
   stores. */
#define MANY_INPUTS 8
#define MANY_NUMBERS 16

/* fmax of the C library keeps to rules for what is no number, and is a call. */
INLINE double larger(double a, double b) { return a > b ? a : b; }

INLINE double sum_of(vec x)
{
#if PMR_VL == 1
    return x;
#elif PMR_VL == 2
    return x[0] + x[1];
#else
    return (x[0] + x[2]) + (x[1] + x[3]);
#endif
}

INLINE double dot(const double *a, const double *b, int begin, int end)
{
    vec sum = {0.0};
    int n;
    for (n = begin; n < end; n += VL) sum += CV(a + n) * CV(b + n);
    return sum_of(sum);
}

/* The same of any memory and number. */
INLINE double dot_loose(const double *a, const double *b, int count)
{
    vec sum = {0.0};
    double rest = 0.0;
    int n;
    for (n = 0; n + VL <= count; n += VL) sum += CONST_LOOSE(a + n) * CONST_LOOSE(b + n);
    for (; n < count; n++) rest += a[n] * b[n];
    return sum_of(sum) + rest;
}

INLINE void copy(double *to, const double *from, int count)
{
    int n = 0; /* a call of memcpy takes longer than this for some ten numbers */
    if (count > MANY_NUMBERS)
        for (; n + VL <= count; n += VL) LOOSE(to + n) = CONST_LOOSE(from + n);
    for (; n < count; n++) to[n] = from[n];
}

/* Polynomials (powers, stride), the highest power first, `width` of them at x; cubics, those of beams, in one go. */
INLINE void evaluate(const double *restrict c, int powers, int stride, int width, double x, double *restrict values)
{
    int n, p;
    if (powers == 4) {
        const double *c1 = c + stride, *c2 = c1 + stride, *c3 = c2 + stride;
        for (n = 0; n < width; n += VL)
            V(values + n) = ((CV(c + n) * x + CV(c1 + n)) * x + CV(c2 + n)) * x + CV(c3 + n);
        return;
    }
    for (n = 0; n < width; n += VL) {
        vec value = CV(c + n);
        for (p = 1; p < powers; p++) value = value * x + CV(c + p * stride + n);
        V(values + n) = value;
    }
}

/* out += columns (count, stride), of any memory, times their shares, four registers at a time: what is added up stays in
   them. */
INLINE void add_columns(const double *restrict columns, int stride, const double *restrict shares, int count,
                        double *restrict out, int width)
{
    int n, q;
    for (n = 0; n + 4 * VL <= width; n += 4 * VL) {
        vec a = LOOSE(out + n), b = LOOSE(out + n + VL), c = LOOSE(out + n + 2 * VL), d = LOOSE(out + n + 3 * VL);
        for (q = 0; q < count; q++) {
            const double *column = columns + (size_t)q * stride + n, share = shares[q];
            a += CONST_LOOSE(column) * share;
            b += CONST_LOOSE(column + VL) * share;
            c += CONST_LOOSE(column + 2 * VL) * share;
            d += CONST_LOOSE(column + 3 * VL) * share;
        }
        LOOSE(out + n) = a;
        LOOSE(out + n + VL) = b;
        LOOSE(out + n + 2 * VL) = c;
        LOOSE(out + n + 3 * VL) = d;
    }
    for (; n + 2 * VL <= width; n += 2 * VL) { /* two sums at a time wait for each other half as long as one */
        vec a = LOOSE(out + n), b = LOOSE(out + n + VL);
        for (q = 0; q < count; q++) {
            a += CONST_LOOSE(columns + (size_t)q * stride + n) * shares[q];
            b += CONST_LOOSE(columns + (size_t)q * stride + n + VL) * shares[q];
        }
        LOOSE(out + n) = a;
        LOOSE(out + n + VL) = b;
    }
    for (; n < width; n += VL) {
        vec a = LOOSE(out + n);
        for (q = 0; q < count; q++) a += CONST_LOOSE(columns + (size_t)q * stride + n) * shares[q];
        LOOSE(out + n) = a;
    }
}

#endif
