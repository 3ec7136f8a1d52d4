/* Loops: rows B of the velocities that contacts do not change. The statement, with its formulas, is contact/joints.py.

With M = L^T D L and the columns A = D^-1/2 L^-T B^T = Q R of independent rows, the inverse mass matrix of what loops leave free is
W = L^-1 D^-1/2 (1 - Q Q^T) D^-1/2 L^-T. */
#include "solver.h"
#include "vectors.h"

#define SINGULAR 1e-10 /* of the largest square of a column of R: below it a row depends on others */

/* The program of q for gaps g and rows B, along w, at the poses of the last `tl_place`. */
static void look(tl_scene *s, const double *q) {
  const tl_block in = {(double *)q, 1, 1, s->nq}, out = {s->loop_gaps, 1, 1, s->loop_program->outputs};
  tl_columns(s->loop_program, s->level, 1, s->loop_registers, 1, 1, &in, 1, &out);
  for (int i = 0; i < s->loops; i++) tl_to_fixed_axes(s, s->loop_rows + i * s->nv);
}

static double dot(const double *a, const double *b, int n) {
  double all = 0.0;
  for (int k = 0; k < n; k++) all += a[k] * b[k];
  return all;
}

static void add(double share, const double *a, double *out, int n) {
  for (int k = 0; k < n; k++) out[k] += share * a[k];
}

/* The largest gap, m. */
double tl_loop_gap(tl_scene *s, const double *q) {
  double most = 0.0;
  if (s->loops) look(s, q);
  for (int i = 0; i < s->loops; i++) most = tl_larger(most, fabs(s->loop_gaps[i]));
  return most;
}

/* The begin (q, w) of a step: B_0 w, and g_0. */
void tl_loops_begin(tl_scene *s, const double *q, const double *w) {
  if (!s->loops) return;
  tl_place(s, q);
  look(s, q);
  for (int i = 0; i < s->loops; i++) s->loop_wanted[i] = dot(s->loop_rows + i * s->nv, w, s->nv), s->loop_open[i] = s->loop_gaps[i];
}

/* x += M^-1 B^T (B M^-1 B^T)^-1 r: R^T y = r, then Q y. */
static void add_response(tl_scene *s, const double *r, double *out) {
  const int m = s->loops, nv = s->nv;
  double *y = s->loop_parts, *x = s->loop_change;
  memset(x, 0, (size_t)nv * sizeof(double));
  for (int i = 0; i < s->loop_rank; i++) {
    y[i] = r[s->loop_order[i]];
    for (int k = 0; k < i; k++) y[i] -= s->loop_factor[k * m + i] * y[k];
    y[i] /= s->loop_factor[i * m + i];
    add(y[i], s->loop_basis + i * nv, x, nv);
  }
  for (int d = 0; d < nv; d++) x[d] /= sqrt(s->inverse[d]);
  tl_outward(s, x);
  add(1.0, x, out, nv);
}

/* Q R of A by the modified Gram-Schmidt process, twice, the largest column first. */
static void factor(tl_scene *s) {
  const int m = s->loops, nv = s->nv;
  double *a = s->loop_basis, largest = 0.0;
  for (int i = 0; i < m; i++) {
    memcpy(a + i * nv, s->loop_rows + i * nv, (size_t)nv * sizeof(double));
    tl_inward(s, a + i * nv);
    for (int d = 0; d < nv; d++) a[i * nv + d] *= sqrt(s->inverse[d]);
    s->loop_order[i] = i;
  }
  memset(s->loop_factor, 0, (size_t)(m * m) * sizeof(double));
  for (s->loop_rank = 0; s->loop_rank < m; s->loop_rank++) {
    const int k = s->loop_rank;
    int best = k;
    for (int i = k + 1; i < m; i++)
      if (dot(a + i * nv, a + i * nv, nv) > dot(a + best * nv, a + best * nv, nv)) best = i;
    const double square = dot(a + best * nv, a + best * nv, nv);
    if (!k) largest = square;
    if (!(square > SINGULAR * largest)) return;
    for (int d = 0; d < nv; d++) {
      const double other = a[best * nv + d];
      a[best * nv + d] = a[k * nv + d], a[k * nv + d] = other;
    }
    for (int i = 0; i < k; i++) {
      const double other = s->loop_factor[i * m + best];
      s->loop_factor[i * m + best] = s->loop_factor[i * m + k], s->loop_factor[i * m + k] = other;
    }
    const int32_t number = s->loop_order[best];
    s->loop_order[best] = s->loop_order[k], s->loop_order[k] = number;
    for (int i = 0; i < k; i++) { /* what rounding left */
      const double share = dot(a + i * nv, a + k * nv, nv);
      s->loop_factor[i * m + k] += share;
      add(-share, a + i * nv, a + k * nv, nv);
    }
    const double length = s->loop_factor[k * m + k] = sqrt(dot(a + k * nv, a + k * nv, nv));
    for (int d = 0; d < nv; d++) a[k * nv + d] /= length;
    for (int i = k + 1; i < m; i++) {
      const double share = s->loop_factor[k * m + i] = dot(a + k * nv, a + i * nv, nv);
      add(-share, a + k * nv, a + i * nv, nv);
    }
  }
}

/* The middle of a step, whose mass matrix has its factors: what B (w + w+) = B_0 w is missed by without w+, and the change that
closes the loops. */
void tl_loops_at(tl_scene *s, const double *middle, const double *w) {
  if (!s->loops) return;
  look(s, middle);
  factor(s);
  for (int i = 0; i < s->loops; i++) s->loop_wanted[i] -= dot(s->loop_rows + i * s->nv, w, s->nv);
  memset(s->loop_closing, 0, (size_t)s->nv * sizeof(double));
  add_response(s, s->loop_open, s->loop_closing);
  for (int d = 0; d < s->nv; d++) s->loop_closing[d] = -s->loop_closing[d];
}

/* w+ without contacts of what is w+ without loops. */
void tl_keep_loops(tl_scene *s, double *free) {
  for (int i = 0; i < s->loops; i++) s->loop_missed[i] = s->loop_wanted[i] - dot(s->loop_rows + i * s->nv, free, s->nv);
  if (s->loops) add_response(s, s->loop_missed, free);
}

/* J and Y of a row over all degrees of freedom, of Y what loops leave free: D^1/2 (1 - Q Q^T) D^-1/2 Y. */
int tl_within_loops(tl_scene *s, tl_row *row) {
  const int nv = s->nv;
  int32_t *dof = tl_take(&s->work, (size_t)nv, sizeof(int32_t));
  double *j = tl_take(&s->work, 6 * (size_t)nv, sizeof(double)), *y = j + 3 * nv;
  if (!dof || !j) return TL_NO_MEMORY;
  memset(j, 0, 6 * (size_t)nv * sizeof(double));
  for (int k = 0; k < row->count; k++) {
    const int at = 3 * (nv - 1 - row->dof[k]);
    tl_copy3(row->j + 3 * k, j + at);
    tl_add_scaled(sqrt(s->inverse[row->dof[k]]), row->y + 3 * k, y + at);
  }
  for (int i = 0; i < s->loop_rank; i++) {
    const double *own = s->loop_basis + i * nv;
    double part[3] = {0, 0, 0};
    for (int d = 0; d < nv; d++) tl_add_scaled(own[d], y + 3 * (nv - 1 - d), part);
    for (int d = 0; d < nv; d++) tl_add_scaled(-own[d], part, y + 3 * (nv - 1 - d));
  }
  for (int d = 0; d < nv; d++) {
    dof[nv - 1 - d] = d;
    for (int m = 0; m < 3; m++) y[3 * (nv - 1 - d) + m] /= sqrt(s->inverse[d]);
  }
  row->count = nv, row->dof = dof, row->j = j, row->y = y;
  return TL_FINE;
}
