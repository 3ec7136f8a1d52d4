/* Taylor's method: the coefficients of the series of a motion, order by order, from the instructions of a program.

x(t + h) = sum_n x_n h^n,   (n + 1) x_(n+1) = f_n, the coefficient of order n of x' = f(t, x)

A program's instructions become recurrences, each with a series of its own (Jorba, Zou: Exp. Math. 14 (2005) 99-117;
Griewank, Walther: Evaluating Derivatives, 2008, ch. 13). A number has 1, 2 or 3 parts (`expansions.h`): 16, 31, 47 digits. */
#ifndef TWOLINK_TAYLOR_H
#define TWOLINK_TAYLOR_H
#include "program.h"

enum { TL_W = 4, TL_MAX_PARTS = 3, TL_MAX_ORDER = 128, TL_TIME_PARTS = 4 };

/* What a recurrence does. SUM: of series, and of products of two. TIMES_ORDER: n x_n. The operands of the others follow in
`operands`, with the series that their recurrences need (`recurrences.h`). */
enum tl_recurrence_kind {
  SERIES_SUM, SERIES_TIMES_ORDER, SERIES_QUOTIENT, SERIES_ROOT, SERIES_SINE, SERIES_EXP, SERIES_TANH, SERIES_ANGLE, SERIES_LESS,
  SERIES_LESS_EQUAL, SERIES_CHOICE, SERIES_POWER
};

/* A product of series a and b, or series a alone where b is below 0. */
typedef struct {
  int32_t a, b, minus;
} tl_term;

/* A recurrence for series `result`. SUM: terms from `first`: constants, which count at order 0 alone; series; constants
times series; series times series. exponent: of POWER. */
typedef struct {
  int32_t kind, result, first, constants, series, scaled, products, operands[7];
  double exponent;
} tl_recurrence;

/* The recurrences of a program with inputs (t, x, constants) and outputs (x', and rates that co-decide the steps). Where all
operands are constant, a recurrence is in the list `once`, which is evaluated at the start. literal: the program's own numbers,
values of the series literal_at. is_constant: of each series. */
typedef struct {
  int moving, inputs, outputs, series, literals, once_count, each_count, terms_count;
  tl_recurrence *once, *each;
  tl_term *terms;
  int32_t *output, *literal_at;
  uint8_t *is_constant;
  double *literal;
} tl_recurrences;

/* One solution. series: part by part, from order -TL_W to `order`, 0 below 0; each of its parts has `stride` numbers. state
(parts x moving): x at the end of a step. powers: of h, and inverse: 1 / n, part by part. time: of the begin of the step. open:
whether the series are those of a step that is not over. */
typedef struct {
  tl_recurrences *own;
  int parts, order, open;
  size_t stride;
  double *memory, *series, *state, *powers, *inverse, time[TL_TIME_PARTS], step, longest;
  int64_t steps;
} tl_taylor;

int tl_recurrences_new(const tl_program *rate, int moving, tl_recurrences **made);
void tl_recurrences_free(tl_recurrences *r);

#define TL_DECLARE_TAYLOR(S)                                                                   \
  void tl_taylor_begin_##S(tl_taylor *one, const double *x, const double *constants);         \
  int64_t tl_taylor_advance_##S(tl_taylor *one, int64_t count, const double *times, double *out, \
                                const tl_disturbance *disturbance, int64_t limit);
#endif
