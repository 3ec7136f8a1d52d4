/* The coefficient of order n of each series, from those of lower orders. Sums go over all j from 0 to n: what is not part of
a recurrence is 0 while it is computed. d: n times the coefficient, for a d/dt. */

/* Adds sum_j a_j b_(n-j), or subtracts it, TL_W terms side by side: below order 0 a series is 0. */
static inline void N(convolve)(tl_vector *sum, const tl_taylor *one, int32_t a, int32_t b, int n, int minus) {
  const double *up = one->series + a, *down = one->series + b + n - (TL_W - 1);
  for (int j = 0; j <= n; j += TL_W) {
    tl_vector x[C], y[C];
    for (int i = 0; i < C; i++) {
      memcpy(&x[i], up + (size_t)i * one->stride + j, sizeof x[i]);
      memcpy(&y[i], down + (size_t)i * one->stride - j, sizeof y[i]);
      y[i] = TL_REVERSED(y[i]);
      if (minus) y[i] = -y[i];
    }
    tl_vector_add_product(C, sum, x, y);
  }
}

/* Adds the columns of a sum to another one. */
static inline void N(folded)(double *total, tl_vector *sum) {
  tl_vector other[C];
  for (int i = 0; i < C; i++) other[i] = TL_HALVES_SWAPPED(sum[i]);
  for (int i = 0; i < C; i++) tl_vector_add(C, sum, i, other[i]);
  for (int i = 0; i < C; i++) {
    const double first = sum[i][0], second = sum[i][1];
    tl_add(C, total, i, first);
    tl_add(C, total, i, second);
  }
}

static inline NUMBER N(at)(const tl_taylor *one, int32_t series, int n) { return N(loaded)(one->series + series + n, one->stride); }
static inline void N(put)(const tl_taylor *one, int32_t series, int n, NUMBER a) {
  N(stored)(one->series + series + n, one->stride, a);
}

static inline NUMBER N(by_order)(const tl_taylor *one, NUMBER a, int n) {
#if C == 1
  (void)one;
  return N(of)(a.part[0] / n);
#else
  return N(times)(a, N(loaded)(one->inverse + n, TL_MAX_ORDER + 1));
#endif
}

/* a_n, or 0, plus or minus sum_j b_j c_(n-j). */
static inline NUMBER N(with_product)(const tl_taylor *one, const NUMBER *a, int32_t b, int32_t c, int n, int minus) {
  tl_vector sum[C] = {{0}};
  double total[C] = {0};
  N(convolve)(sum, one, b, c, n, minus);
  if (a) memcpy(total, a, sizeof total);
  N(folded)(total, sum);
  return N(normal)(total);
}

/* a / b_0, by its reciprocal where b_0 has been divided by before. */
static inline NUMBER N(divided)(const tl_taylor *one, NUMBER a, int32_t b, int32_t reciprocal) {
#if C == 1
  (void)reciprocal;
  return N(over)(a, N(at)(one, b, 0));
#else
  (void)b;
  return N(times)(a, N(at)(one, reciprocal, 0));
#endif
}

static inline NUMBER N(sum_at)(const tl_taylor *one, const tl_recurrence *r, int n) {
  const tl_term *term = one->own->terms + r->first;
  double total[C] = {0};
  if (n) term += r->constants;
  const tl_term *end = one->own->terms + r->first + r->constants + r->series;
  for (; term < end; term++) {
    const NUMBER a = N(at)(one, term->a, n);
    for (int i = 0; i < C; i++) tl_add(C, total, i, term->minus ? -a.part[i] : a.part[i]);
  }
  for (end += r->scaled; term < end; term++) {
    const NUMBER a = N(at)(one, term->a, 0), b = N(at)(one, term->b, n), factor = term->minus ? N(negative)(a) : a;
    tl_add_product(C, total, factor.part, b.part);
  }
  if (r->products) {
    tl_vector sum[C] = {{0}};
    for (end += r->products; term < end; term++) {
      if (term->minus) N(convolve)(sum, one, term->a, term->b, n, 1);
      else N(convolve)(sum, one, term->a, term->b, n, 0);
    }
    N(folded)(total, sum);
  }
  return N(normal)(total);
}

/* Order 0 of a function, and the reciprocal that its recurrence divides by. */
static void N(first)(const tl_taylor *one, const tl_recurrence *r) {
  const int32_t *of = r->operands;
  const NUMBER a = N(at)(one, of[0], 0), b = of[1] < 0 ? N(of)(0.0) : N(at)(one, of[1], 0);
  const NUMBER unit = N(of)(1.0);
  NUMBER result = a, second;
  switch (r->kind) {
    case SERIES_TIMES_ORDER: result = N(of)(0.0); break;
    case SERIES_QUOTIENT: result = N(over)(a, b), N(put)(one, of[2], 0, N(over)(unit, b)); break;
    case SERIES_ROOT: result = N(root)(a), N(put)(one, of[2], 0, N(over)(N(of)(0.5), result)); break;
    case SERIES_SINE: N(sine)(a, &result, &second), N(put)(one, of[3], 0, second); break;
    case SERIES_EXP: result = N(exponential)(a); break;
    case SERIES_TANH: result = N(hyperbolic)(a); break;
    case SERIES_ANGLE: result = N(angle)(a, b), N(put)(one, of[5], 0, N(over)(unit, N(at)(one, of[6], 0))); break;
    case SERIES_LESS: result = N(of)(N(minus)(a, b).part[0] < 0.0 ? 1.0 : 0.0); break;
    case SERIES_LESS_EQUAL: result = N(of)(N(minus)(a, b).part[0] <= 0.0 ? 1.0 : 0.0); break;
    case SERIES_CHOICE: result = a.part[0] != 0.0 ? b : N(at)(one, of[2], 0); break;
    case SERIES_POWER: result = N(power)(a, r->exponent), N(put)(one, of[5], 0, N(over)(unit, a)); break;
    default: break;
  }
  N(put)(one, r->result, 0, result);
}

/* Order n > 0 of a function.

b c = a:  c_n = (a_n - sum b_j c_(n-j)) / b_0         c c = a:  c_n = (a_n - sum c_j c_(n-j)) / (2 c_0)
s = sin a, c = cos a:  n s_n = sum da_j c_(n-j),  n c_n = -sum da_j s_(n-j)      y = e^a:  n y_n = sum da_j y_(n-j)
y = tanh a:  n y_n = sum da_j w_(n-j), w = 1 - y y
y = a^k:  n a_0 y_n = k sum da_j y_(n-j) - sum dy_j a_(n-j)
angle of (x, y):  n s_0 angle_n = sum (dy_j x_(n-j) - dx_j y_(n-j)) - sum dangle_j s_(n-j),  s = x x + y y */
static void N(next)(const tl_taylor *one, const tl_recurrence *r, int n) {
  const int32_t *of = r->operands;
  const NUMBER zero = N(of)(0.0), a = N(at)(one, of[0], n);
  NUMBER result = zero;
  if (r->kind != SERIES_TIMES_ORDER) N(put)(one, r->result, n, zero);
  switch (r->kind) {
    case SERIES_TIMES_ORDER: result = N(times)(a, N(of)(n)); break;
    case SERIES_QUOTIENT: result = N(divided)(one, N(with_product)(one, &a, r->result, of[1], n, 1), of[1], of[2]); break;
    case SERIES_ROOT: {
      result = N(with_product)(one, &a, r->result, r->result, n, 1);
#if C == 1
      result.part[0] /= 2.0 * one->series[r->result];
#else
      result = N(times)(result, N(at)(one, of[2], 0));
#endif
      break;
    }
    case SERIES_SINE:
      N(put)(one, of[3], n, zero);
      result = N(by_order)(one, N(with_product)(one, NULL, of[2], of[3], n, 0), n);
      N(put)(one, of[3], n, N(by_order)(one, N(with_product)(one, NULL, of[2], r->result, n, 1), n));
      break;
    case SERIES_EXP: result = N(by_order)(one, N(with_product)(one, NULL, of[2], r->result, n, 0), n); break;
    case SERIES_TANH:
      N(put)(one, of[3], n, zero);
      result = N(by_order)(one, N(with_product)(one, NULL, of[2], of[3], n, 0), n);
      break;
    case SERIES_ANGLE:
      N(put)(one, of[4], n, zero);
      result = N(with_product)(one, NULL, of[2], of[1], n, 0);
      result = N(with_product)(one, &result, of[3], of[0], n, 1);
      result = N(with_product)(one, &result, of[4], of[6], n, 1);
      result = N(by_order)(one, N(divided)(one, result, of[6], of[5]), n);
      break;
    case SERIES_CHOICE: result = N(at)(one, one->series[of[0]] != 0.0 ? of[1] : of[2], n); break;
    case SERIES_POWER:
      N(put)(one, of[4], n, zero);
      result = N(times)(N(with_product)(one, NULL, of[2], r->result, n, 0), N(of)(r->exponent));
      result = N(with_product)(one, &result, of[4], of[0], n, 1);
      result = N(by_order)(one, N(divided)(one, result, of[0], of[5]), n);
      break;
    default: break;
  }
  N(put)(one, r->result, n, result);
}

static void N(recur)(const tl_taylor *one, const tl_recurrence *list, int count, int n) {
  for (const tl_recurrence *r = list; r < list + count; r++) {
    if (r->kind == SERIES_SUM) N(put)(one, r->result, n, N(sum_at)(one, r, n));
    else if (n) N(next)(one, r, n);
    else N(first)(one, r);
  }
}
