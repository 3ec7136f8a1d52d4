/* Sums of doubles that hold more digits than one: x = x_0 + x_1 + ... with |x_(i+1)| at most half a unit in the last place
of x_i. Included with T, the type of one part (a double, or TL_W of them side by side), and P(name).

Dekker: Numer. Math. 18 (1971) 224-242; Ogita, Rump, Oishi: SIAM J. Sci. Comput. 26 (2005) 1955-1988. The compiler must not
contract products and sums here: the errors of rounding are what is computed. */

/* s + e = a + b exactly, s rounded. */
static inline void P(two_sum)(T a, T b, T *s, T *e) {
  const T sum = a + b, of_b = sum - a;
  *e = (a - (sum - of_b)) + (b - of_b);
  *s = sum;
}

/* p + e = a b exactly, p rounded: by a fused multiply-add, or by halves of the factors (Dekker). */
static inline void P(two_product)(T a, T b, T *p, T *e) {
  const T product = a * b;
#if defined(TL_FUSED)
  *e = P(fused)(a, b, -product);
#else
  const T wide_a = a * 134217729.0, wide_b = b * 134217729.0; /* 2^27 + 1 */
  const T high_a = wide_a - (wide_a - a), high_b = wide_b - (wide_b - b), low_a = a - high_a, low_b = b - high_b;
  *e = low_a * low_b - (((product - high_a * high_b) - low_a * high_b) - high_a * low_b);
#endif
  *p = product;
}

/* Adds x to part `i` of a sum of `parts`; what is rounded off goes to the parts below. */
static inline void P(add)(int parts, T *sum, int i, T x) {
  for (; i < parts - 1; i++) P(two_sum)(sum[i], x, &sum[i], &x);
  if (i == parts - 1) sum[i] = sum[i] + x;
}

/* Adds a b, all of `parts` parts: products of parts i and j count as part i + j. */
static inline void P(add_product)(int parts, T *sum, const T *a, const T *b) {
  for (int i = 0; i < parts; i++)
    for (int j = 0; i + j < parts; j++) {
      if (i + j == parts - 1) {
        sum[parts - 1] = P(fused)(a[i], b[j], sum[parts - 1]);
        continue;
      }
      T p, e;
      P(two_product)(a[i], b[j], &p, &e);
      P(add)(parts, sum, i + j, p);
      P(add)(parts, sum, i + j + 1, e);
    }
}
#undef T
#undef P
