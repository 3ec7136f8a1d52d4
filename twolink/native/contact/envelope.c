/* Matrices of blocks (3 x 3) in an envelope: products, and factors L U without exchanges of blocks.

    A = L U,   L_ij = (A_ij - sum_k L_ik U_kj) U_jj^-1,   U_ji = A_ji - sum_k L_jk U_ki,   k < j

All that arises lies within the envelope. Rows of L and columns of U are kept as rows of numbers, so that all sums are over
neighbours. Source: George, Liu: Computer Solution of Large Sparse Positive Definite Systems, 1981, chapter 4. Compiled once for
each level of a processor: -DLEVEL=base, v3 or v4. */
#include "solver.h"
#include "vectors.h"

#pragma STDC FP_CONTRACT ON

#define JOIN_(a, b) a##_##b
#define JOIN(a, b) JOIN_(a, b)
#define NAMED(name) JOIN(name, LEVEL)

enum { LANES = 4 };
typedef double lanes __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double)), may_alias));

static inline lanes load(const double *x) { return *(const lanes *)x; }
static inline double sum(lanes x) { return (x[0] + x[1]) + (x[2] + x[3]); }

/* out[3 r + c] -= a_r . b_c of three rows each, which lie so many numbers apart. */
static void subtract_dots(const double *a, size_t a_apart, const double *b, size_t b_apart, int count, double *out) {
  const double *a1 = a + a_apart, *a2 = a1 + a_apart, *b1 = b + b_apart, *b2 = b1 + b_apart;
  const int whole = count - count % LANES;
  lanes s0 = {0}, s1 = {0}, s2 = {0}, s3 = {0}, s4 = {0}, s5 = {0}, s6 = {0}, s7 = {0}, s8 = {0};
  for (int k = 0; k < whole; k += LANES) {
    const lanes x = load(b + k), y = load(b1 + k), z = load(b2 + k);
    const lanes u = load(a + k), v = load(a1 + k), w = load(a2 + k);
    s0 += u * x, s1 += u * y, s2 += u * z;
    s3 += v * x, s4 += v * y, s5 += v * z;
    s6 += w * x, s7 += w * y, s8 += w * z;
  }
  double sums[9] = {sum(s0), sum(s1), sum(s2), sum(s3), sum(s4), sum(s5), sum(s6), sum(s7), sum(s8)};
  for (int k = whole; k < count; k++) {
    sums[0] += a[k] * b[k], sums[1] += a[k] * b1[k], sums[2] += a[k] * b2[k];
    sums[3] += a1[k] * b[k], sums[4] += a1[k] * b1[k], sums[5] += a1[k] * b2[k];
    sums[6] += a2[k] * b[k], sums[7] += a2[k] * b1[k], sums[8] += a2[k] * b2[k];
  }
  for (int i = 0; i < 9; i++) out[i] -= sums[i];
}

/* x <- x^-1, with exchanges of rows; 0 where it is singular. */
static int invert(double *x) {
  double a[3][6];
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) a[i][k] = x[3 * i + k], a[i][3 + k] = i == k;
  for (int k = 0; k < 3; k++) {
    int best = k;
    for (int i = k + 1; i < 3; i++)
      if (fabs(a[i][k]) > fabs(a[best][k])) best = i;
    if (!(fabs(a[best][k]) > 1e-300)) return 0;
    for (int c = 0; c < 6; c++) {
      const double other = a[best][c];
      a[best][c] = a[k][c], a[k][c] = other;
    }
    const double share = 1.0 / a[k][k];
    for (int c = 0; c < 6; c++) a[k][c] *= share;
    for (int i = 0; i < 3; i++) {
      if (i == k) continue;
      const double factor = a[i][k];
      for (int c = 0; c < 6; c++) a[i][c] -= factor * a[k][c];
    }
  }
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) x[3 * i + k] = a[i][3 + k];
  return 1;
}

/* The factors in place of the matrix, with U_ii^-1 on the diagonal of `lower`; 0 where a block is singular. */
int NAMED(tl_factor_envelope)(const tl_envelope *a) {
  for (int i = 0; i < a->n; i++) {
    const int first = a->first[i];
    const size_t apart = tl_row_length(a, i);
    double *left = tl_block_at(a, a->lower, i, first), *up = tl_block_at(a, a->upper, i, first), block[9], product[9];
    for (int j = first; j < i; j++) {
      const int low = first > a->first[j] ? first : a->first[j], count = 3 * (j - low);
      const size_t other = tl_row_length(a, j), from = 3 * (size_t)(low - first), to = 3 * (size_t)(j - first);
      tl_get_block(left + to, apart, block);
      subtract_dots(left + from, apart, tl_block_at(a, a->upper, j, low), other, count, block);
      double inverse[9];
      tl_get_block(tl_block_at(a, a->lower, j, j), other, inverse);
      tl_product(block, inverse, product);
      tl_set_block(left + to, apart, product);
      tl_get_block(up + to, apart, block); /* a column of U is a row here: the block is transposed */
      subtract_dots(up + from, apart, tl_block_at(a, a->lower, j, low), other, count, block);
      tl_set_block(up + to, apart, block);
    }
    double *own = tl_block_at(a, a->lower, i, i);
    tl_get_block(own, apart, block);
    subtract_dots(left, apart, up, apart, 3 * (i - first), block);
    if (!invert(block)) return 0;
    tl_set_block(own, apart, block);
  }
  return 1;
}

/* x <- A^-1 x by the factors. */
void NAMED(tl_solve_envelope)(const tl_envelope *a, double *x) {
  for (int i = 0; i < a->n; i++) {
    const size_t apart = tl_row_length(a, i);
    const double *left = tl_block_at(a, a->lower, i, a->first[i]), *from = x + 3 * a->first[i];
    const int count = 3 * (i - a->first[i]);
    for (int r = 0; r < 3; r++, left += apart) {
      double all = 0.0;
      for (int k = 0; k < count; k++) all += left[k] * from[k];
      x[3 * i + r] -= all;
    }
  }
  for (int i = a->n - 1; i >= 0; i--) {
    const size_t apart = tl_row_length(a, i);
    const double *up = tl_block_at(a, a->upper, i, a->first[i]);
    const int count = 3 * (i - a->first[i]);
    double inverse[9], y[3], *to = x + 3 * a->first[i];
    tl_get_block(tl_block_at(a, a->lower, i, i), apart, inverse);
    tl_times(inverse, x + 3 * i, y);
    tl_copy3(y, x + 3 * i);
    for (int c = 0; c < 3; c++, up += apart)
      for (int k = 0; k < count; k++) to[k] -= up[k] * y[c];
  }
}

/* out = G p of a symmetric matrix. */
void NAMED(tl_envelope_times)(const tl_envelope *g, const double *p, double *restrict out) {
  memset(out, 0, (size_t)g->n * 3 * sizeof(double));
  for (int i = 0; i < g->n; i++) {
    const size_t apart = tl_row_length(g, i);
    const int first = 3 * g->first[i], count = 3 * i - first, whole = count - count % LANES;
    const double *a = tl_block_at(g, g->lower, i, g->first[i]), *b = a + apart, *c = b + apart, *from = p + first;
    const double x = p[3 * i], y = p[3 * i + 1], z = p[3 * i + 2];
    double *restrict to = out + first;
    lanes s0 = {0}, s1 = {0}, s2 = {0};
    for (int k = 0; k < whole; k += LANES) {
      const lanes u = load(a + k), v = load(b + k), w = load(c + k), own = load(from + k);
      s0 += u * own, s1 += v * own, s2 += w * own;
      *(lanes *)(to + k) = load(to + k) + (u * x + v * y + w * z);
    }
    double sums[3] = {sum(s0), sum(s1), sum(s2)};
    for (int k = whole; k < count; k++) {
      sums[0] += a[k] * from[k], sums[1] += b[k] * from[k], sums[2] += c[k] * from[k];
      to[k] += a[k] * x + b[k] * y + c[k] * z;
    }
    out[3 * i] += sums[0] + a[count] * x + a[count + 1] * y + a[count + 2] * z;
    out[3 * i + 1] += sums[1] + b[count] * x + b[count + 1] * y + b[count + 2] * z;
    out[3 * i + 2] += sums[2] + c[count] * x + c[count + 1] * y + c[count + 2] * z;
  }
}
