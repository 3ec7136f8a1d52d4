/* Matrices of blocks (3 x 3) in an envelope: products, and factors L U without exchanges of blocks.

    A = L U,   L_ij = (A_ij - sum_k L_ik U_kj) U_jj^-1,   U_ji = A_ji - sum_k L_jk U_ki,   k < j

All that arises lies within the envelope. Source: George, Liu: Computer Solution of Large Sparse Positive Definite Systems,
1981, chapter 4. */
#include "contact_solver.h"
#include "contact_vectors.h"

/* Block (i, j) of the lower triangle, or (j, i) of the upper one, first[i] <= j <= i. */
double *tl_block_at(const tl_envelope *g, double *triangle, int i, int j) {
  return triangle + 9 * (g->at[i] + (size_t)(j - g->first[i]));
}

/* out = G p of a symmetric matrix. */
void tl_envelope_times(const tl_envelope *g, const double *p, double *out) {
  memset(out, 0, (size_t)g->n * 3 * sizeof(double));
  for (int i = 0; i < g->n; i++) {
    const double *block = g->lower + 9 * g->at[i], *own = p + 3 * i;
    double sum[3] = {0, 0, 0};
    for (int j = g->first[i]; j < i; j++, block += 9) {
      const double *x = p + 3 * j;
      double *to = out + 3 * j;
      for (int k = 0; k < 3; k++) {
        sum[k] += block[3 * k] * x[0] + block[3 * k + 1] * x[1] + block[3 * k + 2] * x[2];
        to[k] += block[k] * own[0] + block[3 + k] * own[1] + block[6 + k] * own[2];
      }
    }
    for (int k = 0; k < 3; k++)
      out[3 * i + k] += sum[k] + block[3 * k] * own[0] + block[3 * k + 1] * own[1] + block[3 * k + 2] * own[2];
  }
}

/* out -= A B */
static void subtract_product(const double *a, const double *b, double *out) {
  for (int r = 0; r < 3; r++)
    for (int c = 0; c < 3; c++) out[3 * r + c] -= a[3 * r] * b[c] + a[3 * r + 1] * b[3 + c] + a[3 * r + 2] * b[6 + c];
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
int tl_factor_envelope(const tl_envelope *a) {
  for (int i = 0; i < a->n; i++) {
    double *const left = a->lower + 9 * a->at[i], *const up = a->upper + 9 * a->at[i], *own = tl_block_at(a, a->lower, i, i);
    for (int j = a->first[i]; j < i; j++) {
      double *l = left + 9 * (j - a->first[i]), *u = up + 9 * (j - a->first[i]), x[9];
      for (int k = a->first[i] > a->first[j] ? a->first[i] : a->first[j]; k < j; k++) {
        subtract_product(left + 9 * (k - a->first[i]), tl_block_at(a, a->upper, j, k), l);
        subtract_product(tl_block_at(a, a->lower, j, k), up + 9 * (k - a->first[i]), u);
      }
      tl_product(l, tl_block_at(a, a->lower, j, j), x);
      memcpy(l, x, sizeof x);
      subtract_product(l, u, own);
    }
    if (!invert(own)) return 0;
  }
  return 1;
}

/* x <- A^-1 x by the factors. */
void tl_solve_envelope(const tl_envelope *a, double *x) {
  double y[3];
  for (int i = 0; i < a->n; i++)
    for (int j = a->first[i]; j < i; j++) {
      tl_times(tl_block_at(a, a->lower, i, j), x + 3 * j, y);
      tl_add_scaled(-1, y, x + 3 * i);
    }
  for (int i = a->n - 1; i >= 0; i--) {
    tl_times(tl_block_at(a, a->lower, i, i), x + 3 * i, y);
    tl_copy3(y, x + 3 * i);
    for (int j = a->first[i]; j < i; j++) {
      tl_times(tl_block_at(a, a->upper, i, j), x + 3 * i, y);
      tl_add_scaled(-1, y, x + 3 * j);
    }
  }
}
