/* Drivers over time. */
#include "internal.h"

#include <math.h>

/* So few pieces are looked at one after the other: processors predict where that ends, and no halving waits for the one
   before. */
#define FEW_PIECES 8

/* The piece of a strand that counts at t. */
INLINE int32_t piece_at(const pmr_signals *signals, int32_t strand, double t)
{
    int32_t low = signals->first_piece[strand], high = signals->first_piece[strand + 1];
    while (high - low > FEW_PIECES) {
        const int32_t middle = low + (high - low) / 2;
        if (t < signals->breaks[middle])
            high = middle;
        else
            low = middle;
    }
    while (low + 1 < high && t >= signals->breaks[low + 1]) low++;
    return low;
}

/* A strand's value and, unless NULL, its first two rates. */
INLINE double strand_at(const pmr_signals *signals, int32_t strand, double t, double rates[2])
{
    const int32_t piece = piece_at(signals, strand, t);
    const double *p = signals->pieces + (size_t)(signals->powers + 4) * piece, *q = p + signals->powers;
    const double x = t - signals->breaks[piece];
    double value = p[0], slope = 0.0, curve = 0.0;
    int32_t k;
    for (k = 1; k < signals->powers; k++) { /* Horner's rule, twice differentiated */
        if (rates) {
            curve = curve * x + 2.0 * slope;
            slope = slope * x + value;
        }
        value = value * x + p[k];
    }
    if (q[0] != 0.0) {
        const double angle = (q[1] * x + q[2]) * x + q[3], turning = 2.0 * q[1] * x + q[2];
        value += q[0] * sin(angle);
        if (rates) {
            slope += q[0] * turning * cos(angle);
            curve += q[0] * (2.0 * q[1] * cos(angle) - turning * turning * sin(angle));
        }
    }
    if (rates) rates[0] = slope, rates[1] = curve;
    return value;
}

/* How fast the rate of a strand grows within h around t. */
static double spread_at(const pmr_signals *signals, int32_t strand, double t, double h)
{
    const double half = h / 2.0, before = t - half > 0.0 ? t - half : 0.0;
    double first[2], last[2];
    strand_at(signals, strand, before, first);
    strand_at(signals, strand, t + half, last);
    return (last[0] - first[0]) / (t + half - before);
}

double pmr_signals_spread(const pmr_signals *signals, int32_t driver, double t, double h)
{
    double sum = 0.0;
    int32_t strand;
    for (strand = signals->first_strand[driver]; strand < signals->first_strand[driver + 1]; strand++)
        sum += spread_at(signals, strand, t, h);
    return sum;
}

void pmr_signals_at(const pmr_signals *signals, double t, double *u, double *rates)
{
    const int32_t count = signals->drivers;
    int32_t n, strand;
    for (n = 0; n < count; n++) {
        double value = 0.0, slope = 0.0, curve = 0.0, own[2] = {0.0, 0.0};
        for (strand = signals->first_strand[n]; strand < signals->first_strand[n + 1]; strand++) {
            const double h = signals->spread ? signals->spread[strand] : 0.0;
            if (h > 0.0) {
                const double half = h / 2.0, before = t - half > 0.0 ? t - half : 0.0;
                value += spread_at(signals, strand, t, h);
                if (rates)
                    own[0] = (spread_at(signals, strand, t + half, h) - spread_at(signals, strand, before, h)) /
                             (t + half - before);
                own[1] = 0.0;
            } else if (h < 0.0) {
                strand_at(signals, strand, t, own);
                value += own[1];
                own[0] = own[1] = 0.0;
            } else {
                value += rates ? strand_at(signals, strand, t, own) : strand_at(signals, strand, t, NULL);
            }
            slope += own[0];
            curve += own[1];
        }
        u[n] = value;
        if (rates) {
            rates[n] = slope;
            rates[count + n] = curve;
        }
    }
}

void pmr_lead_on(const double *led, int n, double t, int rows, double *to)
{
    int k;
    for (k = 0; k < n; k++) {
        const double u = led[k], u1 = led[n + k], u2 = led[2 * n + k], u3 = led[3 * n + k];
        to[k] = u + t * (u1 + t / 2.0 * (u2 + t / 3.0 * u3));
        if (rows > 1) to[n + k] = u1 + t * (u2 + t / 2.0 * u3);
        if (rows > 2) to[2 * n + k] = u2 + t * u3;
    }
}
