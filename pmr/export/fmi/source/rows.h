/* The contacts' rows as polynomials in the path coordinates. */
#ifndef ROWS_H
#define ROWS_H

#include "body.h"

/* A block is what travels along one path on one body: its contacts, and others that stay on this body.  Tables are
   polynomials in s between breaks, the highest power first, one block after the other.  WHOLE: one block has all rows, with
   nothing that stays beside it. */
extern const double breaks[];
extern const int contacts[];
extern const double table_C[]; /* interval, power, contact, mode */
extern const double table_G[]; /* interval, power, contact, contact of the block */
extern const double table_S[]; /* interval, power, contact, contact that stays */
extern const double table_H[]; /* interval, power, contact, input */
extern const double table_X[]; /* interval, power, contact, output */
/* A pair are two blocks of one body on different paths.  Between their contacts G is w(s) R v(s')^T, with weights w and v on
   the carriers that a contact touches. */
extern const int touched[];    /* interval, contact, carrier */
extern const double weights[]; /* interval, contact, power, carrier */
extern const double between[]; /* R: carrier of the first block, carrier of the second */
/* What stays everywhere, and 1/k on the diagonal of F. */
extern const double constant_C[ROWS][MODES];
extern const double constant_F[ROWS][ROWS];
extern const double constant_H[ROWS][INPUTS];
extern const double constant_X[ROWS][OUTPUTS];
extern const double path_ends[PATHS][2];
extern const char *const path_names[PATHS];

/* The rows at the present path coordinates; 1 with the reason in `message` if one of these lies off its path. */
int place(Body *body);

/* How these change along path coordinates (PATHS,), or how that changes along others. */
void change(const Body *body, const double *along, const double *and_along, Rows *rows);

/* y += factor X multipliers, or with the change of X; both NULL: X itself. */
void add_local(const Body *body, const double *along, const double *and_along, const double *multipliers, double factor,
               double *y);

/* The path coordinates, by their names. */
void say_where(const Body *body, char *text, size_t size);

#endif
