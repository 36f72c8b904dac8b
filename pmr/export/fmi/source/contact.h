/* Multipliers of rows, some of which may only push. */
#ifndef CONTACT_H
#define CONTACT_H

#include "body.h"

/* Multipliers with A lambda = excess at the closed rows, and zero at the others, by block principal pivoting with
   Murty's rule behind it; `among`: the rows in question.  1 if a row depends on others, or nothing was settled. */
int settle(Body *body, double A[ROWS][ROWS], const double *motion, const int *among, double *multipliers);

/* The same where it is known which rows are closed. */
int solve_closed(Body *body, double A[ROWS][ROWS], const int *among, double *motion_to_multipliers);

/* Take back what rows that have just opened would add to this step by their force in the one before: 1 if any did. */
int let_go(Body *body, const int *among);

/* What the multipliers of the rows that push leave for the next step. */
void remember(Body *body);

#endif
