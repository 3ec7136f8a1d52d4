/* What Python calls of Taylor's method, by the code for this processor. */
#include "taylor.h"

#include <stdlib.h>
#include <string.h>

typedef void (*begin_function)(tl_taylor *, const double *, const double *);
typedef int64_t (*advance_function)(tl_taylor *, int64_t, const double *, double *, const tl_disturbance *, int64_t);
#define ALL_PARTS(level) TL_DECLARE_TAYLOR(c1##level) TL_DECLARE_TAYLOR(c2##level) TL_DECLARE_TAYLOR(c3##level)
#define TABLE(name, level) {name##_c1##level, name##_c2##level, name##_c3##level}

ALL_PARTS(base)
#if defined(X86_LEVELS)
ALL_PARTS(v3)
ALL_PARTS(v4)
static const begin_function BEGIN[3][3] = {TABLE(tl_taylor_begin, base), TABLE(tl_taylor_begin, v3), TABLE(tl_taylor_begin, v4)};
static const advance_function ADVANCE[3][3] = {TABLE(tl_taylor_advance, base), TABLE(tl_taylor_advance, v3),
                                               TABLE(tl_taylor_advance, v4)};
#else
static const begin_function BEGIN[1][3] = {TABLE(tl_taylor_begin, base)};
static const advance_function ADVANCE[1][3] = {TABLE(tl_taylor_advance, base)};
#endif

TL_API void tl_taylor_free(tl_taylor *one) {
  if (!one) return;
  tl_recurrences_free(one->own);
  tl_free_aligned(one->memory);
  free(one);
}

/* Numbers of series become places in memory. */
static void place(tl_recurrences *r, int32_t apart) {
  tl_recurrence *const lists[2] = {r->once, r->each};
  const int counts[2] = {r->once_count, r->each_count};
  for (int k = 0; k < 2; k++)
    for (int i = 0; i < counts[k]; i++) {
      lists[k][i].result *= apart;
      for (int j = 0; j < 7; j++) lists[k][i].operands[j] *= apart;
    }
  for (int i = 0; i < r->terms_count; i++) r->terms[i].a *= apart, r->terms[i].b *= apart;
  for (int i = 0; i < r->literals; i++) r->literal_at[i] *= apart;
  for (int i = 0; i < r->outputs; i++) { /* from now on is_constant is that of outputs */
    r->is_constant[i + r->series] = r->is_constant[r->output[i]];
    r->output[i] *= apart;
  }
  memmove(r->is_constant, r->is_constant + r->series, (size_t)r->outputs);
}

/* The memory of a solution, with its recurrences; a code. */
static int prepared(tl_taylor *one, const tl_program *rate, int moving) {
  const size_t parts = (size_t)one->parts;
  one->stride = ((size_t)one->order + 1 + 2 * TL_W + TL_W - 1) / TL_W * TL_W;
  const int code = tl_recurrences_new(rate, moving, &one->own);
  if (code) return code;
  const size_t apart = one->stride * parts, series = (size_t)one->own->series * apart;
  if (series > INT32_MAX) return TL_TOO_WIDE;
  one->memory = tl_aligned((TL_W + series + apart + (size_t)moving * parts + (TL_MAX_ORDER + 1) * parts) * sizeof(double));
  if (!one->memory) return TL_NO_MEMORY;
  one->series = one->memory + TL_W;
  one->powers = one->series + series;
  one->state = one->powers + apart;
  one->inverse = one->state + (size_t)moving * parts;
  place(one->own, (int32_t)apart);
  return TL_FINE;
}

/* A solution of x' = rate(t, x, constants) from time t and x (moving x parts), by polynomials of an order, with no step longer
than `longest`; further outputs of the rate co-decide the steps. Returns a code; the solution is written to `made`. */
TL_API int tl_taylor_new(const tl_program *rate, int level, int moving, int order, int parts, double t, const double *x,
                         const double *constants, double longest, tl_taylor **made) {
  *made = NULL;
  if (!rate || level < 0 || level > tl_level() || moving < 1 || rate->inputs < 1 + moving || rate->outputs < moving ||
      order < 3 || order > TL_MAX_ORDER || parts < 1 || parts > TL_MAX_PARTS || !x || !(longest > 0.0))
    return TL_BAD_ARGUMENT;
  tl_taylor *one = calloc(1, sizeof *one);
  if (!one) return TL_NO_MEMORY;
  one->parts = parts, one->order = order, one->time[0] = t, one->longest = longest;
  const int code = prepared(one, rate, moving);
  if (code) {
    tl_taylor_free(one);
    return code;
  }
  BEGIN[level][parts - 1](one, x, constants);
  *made = one;
  return TL_FINE;
}

/* Samples (count x moving x parts) at increasing times, in up to `limit` steps. Returns how many were made, or a code below 0;
reached: the time at which the last step begins, and how many steps there were. */
TL_API int64_t tl_taylor_advance(tl_taylor *one, int level, int64_t count, const double *times, double *out,
                                 const tl_disturbance *disturbance, int64_t limit, double *reached) {
  if (!one || level < 0 || level > tl_level() || count < 0 || limit < 0 || (count && (!times || !out)) ||
      (disturbance && (disturbance->period < 1 || disturbance->parts[0] < 0 || disturbance->parts[1] > one->own->moving ||
                       disturbance->parts[2] < 0 || disturbance->parts[3] > one->own->moving)))
    return -TL_BAD_ARGUMENT;
  const int64_t done = ADVANCE[level][one->parts - 1](one, count, times, out, disturbance, limit);
  reached[0] = one->time[0], reached[1] = (double)one->steps;
  return done;
}
