/* Taylor's method in numbers of 1, 2 and 3 parts; compiled once for each level of a processor: -DLEVEL=base, v3 or v4. */
#include "taylor.h"

#include <math.h>
#include <string.h>

#pragma STDC FP_CONTRACT OFF

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

typedef double tl_vector __attribute__((vector_size(8 * TL_W)));
#define TL_REVERSED(v) __builtin_shufflevector(v, v, 3, 2, 1, 0)
#define TL_HALVES_SWAPPED(v) __builtin_shufflevector(v, v, 2, 3, 0, 1)

#if defined(__FMA__) || defined(__aarch64__)
#define TL_FUSED
static inline double tl_fused(double a, double b, double c) { return __builtin_fma(a, b, c); }
static inline tl_vector tl_vector_fused(tl_vector a, tl_vector b, tl_vector c) {
#if defined(__clang__)
  return __builtin_elementwise_fma(a, b, c);
#else
  for (int i = 0; i < TL_W; i++) c[i] = __builtin_fma(a[i], b[i], c[i]);
  return c;
#endif
}
#else
static inline double tl_fused(double a, double b, double c) { return a * b + c; }
static inline tl_vector tl_vector_fused(tl_vector a, tl_vector b, tl_vector c) { return a * b + c; }
#endif

#define T double
#define P(name) tl_##name
#include "expansions.h"
#define T tl_vector
#define P(name) tl_vector_##name
#include "expansions.h"

static const double TL_HALF_PI[4] = {1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33, 5.562271104316826e-50};
static const double TL_LOG_2[4] = {0.6931471805599453, 2.3190468138462996e-17, 5.707708438416212e-34, -3.5824322106018114e-50};

#define C 1
#define SUFFIX JOIN(c1, LEVEL)
#include "numbers.h"
#include "elementary.h"
#include "recurrences.h"
#include "taylor_steps.h"

#define C 2
#define SUFFIX JOIN(c2, LEVEL)
#include "numbers.h"
#include "elementary.h"
#include "recurrences.h"
#include "taylor_steps.h"

#define C 3
#define SUFFIX JOIN(c3, LEVEL)
#include "numbers.h"
#include "elementary.h"
#include "recurrences.h"
#include "taylor_steps.h"
