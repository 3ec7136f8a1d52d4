/* Equations of contacts by the motion of the bodies: products with G, and factors of what takes the place of G.

    (E + C G) p = f,   G = Y^T D^-1 Y,   x = D^-1 Y p
    (D + Y E^-1 C Y^T) x = Y E^-1 f,     p = E^-1 (f - C Y^T x)

E and C are blocks (3 x 3) of points. The matrix has a block (6 x 6) of each two nodes that a point connects: four points of a
face are six numbers. Its factors L U have the blocks L_ji = A_ji - sum_k L_jk U_ki and U_ij = L_ii^-1 (A_ij - sum_k L_ik U_kj),
k < i < j, where the nodes stand in the order of their elimination, and no more than `below` says. Sources: Woodbury's formula;
George, Liu: Computer Solution of Large Sparse Positive Definite Systems, 1981, chapter 5. Compiled once for each level of a
processor: -DLEVEL=base, v3 or v4. */
#include "solver.h"
#include "vectors.h"

#pragma STDC FP_CONTRACT ON

#define JOIN_(a, b) a##_##b
#define JOIN(a, b) JOIN_(a, b)
#define NAMED(name) JOIN(name, LEVEL)

typedef double lanes __attribute__((vector_size(TL_LANES * sizeof(double)), aligned(sizeof(double)), may_alias));

static inline lanes load(const double *x) { return *(const lanes *)x; }
static inline void store(double *to, lanes x) { *(lanes *)to = x; }
static inline double sum(lanes x) { return ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7])); }

/* x += Y p of a point, by nodes. */
static inline void add_motion(const tl_system *a, int i, const double *p) {
  for (int m = a->first[i]; m < a->first[i + 1]; m++) {
    const double *y = a->y + TL_PART * (size_t)m;
    double *x = a->x + TL_LANES * (size_t)a->node[m];
    store(x, load(x) + (p[0] * load(y) + p[1] * load(y + TL_LANES) + p[2] * load(y + 2 * TL_LANES)));
  }
}

/* Y^T x of a point. */
static inline void velocity(const tl_system *a, int i, double *u) {
  lanes s0 = {0}, s1 = {0}, s2 = {0};
  for (int m = a->first[i]; m < a->first[i + 1]; m++) {
    const double *y = a->y + TL_PART * (size_t)m;
    const lanes x = load(a->x + TL_LANES * (size_t)a->node[m]);
    s0 += load(y) * x, s1 += load(y + TL_LANES) * x, s2 += load(y + 2 * TL_LANES) * x;
  }
  u[0] = sum(s0), u[1] = sum(s1), u[2] = sum(s2);
}

/* out = G p. */
void NAMED(tl_system_times)(const tl_system *a, const double *p, double *out) {
  memset(a->x, 0, (size_t)a->nodes * TL_LANES * sizeof(double));
  for (int i = 0; i < a->points; i++) add_motion(a, i, p + 3 * i);
  for (double *x = a->x, *mass = a->mass; x < a->x + TL_LANES * (size_t)a->nodes; x += TL_LANES, mass += TL_LANES)
    store(x, load(x) / load(mass));
  for (int i = 0; i < a->points; i++) velocity(a, i, out + 3 * i);
}

/* Where the block of two nodes is, rows of one and columns of the other. */
static double *block_of(const tl_system *a, int row, int column) {
  const int k = row < column ? row : column, j = row < column ? column : row;
  if (row == column) return a->own + TL_BLOCK * (size_t)k;
  int low = a->start[k], high = a->start[k + 1] - 1;
  while (low < high) {
    const int middle = (low + high) / 2;
    if (a->below[middle] < j) low = middle + 1;
    else high = middle;
  }
  return (row < column ? a->upper : a->lower) + TL_BLOCK * (size_t)low;
}

/* D + Y E^-1 C Y^T. */
static void assemble(const tl_system *a) {
  const size_t block = TL_BLOCK * sizeof(double);
  memset(a->own, 0, (size_t)a->nodes * block);
  memset(a->lower, 0, (size_t)a->start[a->nodes] * block);
  memset(a->upper, 0, (size_t)a->start[a->nodes] * block);
  for (int k = 0; k < a->nodes; k++)
    for (int r = 0; r < TL_NODE; r++)
      a->own[TL_BLOCK * (size_t)k + (TL_LANES + 1) * (size_t)r] = a->mass[TL_LANES * k + r];
  for (int i = 0; i < a->points; i++) {
    const double *c = a->coupling + 9 * i;
    if (c[0] == 0.0 && c[4] == 0.0 && c[8] == 0.0) continue;
    for (int m = a->first[i]; m < a->first[i + 1]; m++) {
      const double *y = a->y + TL_PART * (size_t)m;
      const lanes y0 = load(y), y1 = load(y + TL_LANES), y2 = load(y + 2 * TL_LANES);
      const lanes t0 = c[0] * y0 + c[1] * y1 + c[2] * y2, t1 = c[3] * y0 + c[4] * y1 + c[5] * y2;
      const lanes t2 = c[6] * y0 + c[7] * y1 + c[8] * y2;
      for (int k = a->first[i]; k < a->first[i + 1]; k++) {
        const double *z = a->y + TL_PART * (size_t)k;
        double *to = block_of(a, a->node[k], a->node[m]);
        for (int r = 0; r < TL_NODE; r++, to += TL_LANES)
          store(to, load(to) + (z[r] * t0 + z[TL_LANES + r] * t1 + z[2 * TL_LANES + r] * t2));
      }
    }
  }
}

/* out -= a b of blocks. */
static inline void subtract(double *out, const double *a, const double *b) {
  lanes rows[TL_NODE];
  for (int r = 0; r < TL_NODE; r++) rows[r] = load(b + TL_LANES * r);
  for (int r = 0; r < TL_NODE; r++, out += TL_LANES, a += TL_LANES)
    store(out, load(out) - (((a[0] * rows[0] + a[1] * rows[1]) + a[2] * rows[2]) +
                            ((a[3] * rows[3] + a[4] * rows[4]) + a[5] * rows[5])));
}

/* The factors of a block with exchanges of rows, in its place; order: the rows in theirs. 0 where it is singular. An inverse would
lose what stiff contacts leave of motions along them. */
static int factor_block(double *x, int32_t *order) {
  for (int k = 0; k < TL_NODE; k++) order[k] = k;
  for (int k = 0; k < TL_NODE; k++) {
    double *own = x + TL_LANES * k;
    int best = k;
    for (int r = k + 1; r < TL_NODE; r++)
      if (fabs(x[TL_LANES * r + k]) > fabs(x[TL_LANES * best + k])) best = r;
    const lanes other = load(x + TL_LANES * best);
    const int32_t number = order[best];
    store(x + TL_LANES * best, load(own)), order[best] = order[k];
    store(own, other), order[k] = number;
    if (!(fabs(own[k]) > 1e-300)) return 0;
    own[k] = 1.0 / own[k];
    for (int r = k + 1; r < TL_NODE; r++) {
      double *row = x + TL_LANES * r;
      row[k] *= own[k];
      for (int c = k + 1; c < TL_NODE; c++) row[c] -= row[k] * own[c];
    }
  }
  return 1;
}

/* x <- D^-1 x of a block, and of a vector, by the factors of D. */
static inline void solve_block(const double *d, const int32_t *order, double *x) {
  lanes rows[TL_NODE];
  for (int r = 0; r < TL_NODE; r++) {
    rows[r] = load(x + TL_LANES * order[r]);
    for (int c = 0; c < r; c++) rows[r] -= d[TL_LANES * r + c] * rows[c];
  }
  for (int r = TL_NODE - 1; r >= 0; r--) {
    for (int c = r + 1; c < TL_NODE; c++) rows[r] -= d[TL_LANES * r + c] * rows[c];
    rows[r] *= d[(TL_LANES + 1) * r];
  }
  for (int r = 0; r < TL_NODE; r++) store(x + TL_LANES * r, rows[r]);
}

static inline void solve_vector(const double *d, const int32_t *order, double *x) {
  double y[TL_NODE];
  for (int r = 0; r < TL_NODE; r++) {
    y[r] = x[order[r]];
    for (int c = 0; c < r; c++) y[r] -= d[TL_LANES * r + c] * y[c];
  }
  for (int r = TL_NODE - 1; r >= 0; r--) {
    for (int c = r + 1; c < TL_NODE; c++) y[r] -= d[TL_LANES * r + c] * x[c];
    x[r] = y[r] * d[(TL_LANES + 1) * r];
  }
}

/* Let a node, whose blocks are there from one on, wait for the node of that block. */
static void wait_for(const tl_system *a, int k, int from) {
  if (from == a->start[k + 1]) return;
  a->next[k] = from, a->after[k] = a->waiting[a->below[from]], a->waiting[a->below[from]] = k;
}

/* The factors, with those of L_ii in place of `own`; 0 where a block is singular. */
int NAMED(tl_factor_system)(const tl_system *a) {
  double *lower = a->lower, *upper = a->upper;
  assemble(a);
  for (int i = 0; i < a->nodes; i++) a->waiting[i] = -1;
  for (int i = 0; i < a->nodes; i++) {
    double *own = a->own + TL_BLOCK * (size_t)i;
    for (int m = a->start[i]; m < a->start[i + 1]; m++) a->at[a->below[m]] = m;
    for (int k = a->waiting[i], after; k >= 0; k = after) {
      const size_t first = TL_BLOCK * (size_t)a->next[k];
      after = a->after[k];
      subtract(own, lower + first, upper + first);
      for (int m = a->next[k] + 1; m < a->start[k + 1]; m++) {
        const size_t from = TL_BLOCK * (size_t)m, to = TL_BLOCK * (size_t)a->at[a->below[m]];
        subtract(lower + to, lower + from, upper + first);
        subtract(upper + to, lower + first, upper + from);
      }
      wait_for(a, k, a->next[k] + 1);
    }
    int32_t *order = a->order + TL_NODE * i;
    if (!factor_block(own, order)) return 0;
    for (int m = a->start[i]; m < a->start[i + 1]; m++) solve_block(own, order, upper + TL_BLOCK * (size_t)m);
    wait_for(a, i, a->start[i]);
  }
  return 1;
}

/* out -= a x of a block. */
static inline void subtract_product(double *out, const double *a, const double *x) {
  const lanes own = load(x);
  for (int r = 0; r < TL_NODE; r++) out[r] -= sum(load(a + TL_LANES * r) * own);
}

/* p in place of f, by the factors. */
void NAMED(tl_solve_system)(const tl_system *a, double *p) {
  memset(a->x, 0, (size_t)a->nodes * TL_LANES * sizeof(double));
  for (int i = 0; i < a->points; i++) {
    double y[3];
    tl_times(a->inverse + 9 * i, p + 3 * i, y);
    tl_copy3(y, p + 3 * i);
    add_motion(a, i, y);
  }
  for (int i = 0; i < a->nodes; i++) {
    double *x = a->x + TL_LANES * (size_t)i;
    solve_vector(a->own + TL_BLOCK * (size_t)i, a->order + TL_NODE * i, x);
    for (int m = a->start[i]; m < a->start[i + 1]; m++)
      subtract_product(a->x + TL_LANES * (size_t)a->below[m], a->lower + TL_BLOCK * (size_t)m, x);
  }
  for (int i = a->nodes - 1; i >= 0; i--)
    for (int m = a->start[i]; m < a->start[i + 1]; m++)
      subtract_product(a->x + TL_LANES * (size_t)i, a->upper + TL_BLOCK * (size_t)m, a->x + TL_LANES * (size_t)a->below[m]);
  for (int i = 0; i < a->points; i++) {
    double u[3], y[3];
    velocity(a, i, u);
    tl_times(a->coupling + 9 * i, u, y);
    for (int k = 0; k < 3; k++) p[3 * i + k] -= y[k];
  }
}
