/* Positions at the end of a step: the motion dq = M^-1 J^T nu that removes what velocities leave of gaps and of drift. Statement
and source: contact/positions.py.

Rows that are not sought or do not press have the equation nu = 0, so that a point always has a block of three. */
#include "step.h"
#include "vectors.h"

#define SOFT 1e-6 /* of G at a contact: slip yields to overlap where not both can be removed */
enum { SETS = 40 };

/* The rows (3n) of points in the order of their islands: gaps and slips, what is sought, what is an equation, what presses,
the size of G and what makes it regular, and nu. */
typedef struct {
  int n;
  const tl_place_of *order;
  tl_envelope g, matrix;
  double *off, *size, *regular, *nu, *u;
  uint8_t *sought, *equal, *pressing;
} rows_of_positions;

static int new_rows(tl_scene *s, const tl_law *law, const double *off, const uint8_t *sought, const uint8_t *equal,
                    rows_of_positions *out) {
  const size_t count = 3 * (size_t)out->n;
  const tl_row **rows = tl_take(&s->work, (size_t)out->n, sizeof *rows);
  double *x = tl_take(&s->work, 5 * count, sizeof(double));
  uint8_t *marks = tl_take(&s->work, 3 * count, 1);
  if (!rows || !x || !marks) return TL_NO_MEMORY;
  out->off = x, out->size = x + count, out->regular = x + 2 * count, out->nu = x + 3 * count, out->u = x + 4 * count;
  out->sought = marks, out->equal = marks + count, out->pressing = marks + 2 * count;
  for (int i = 0; i < out->n; i++) {
    const int k = out->order[i].point, code = tl_need_row(s, law->points + k, law->rows + k);
    if (code) return code;
    rows[i] = law->rows + k;
    for (int m = 0; m < 3; m++) {
      out->off[3 * i + m] = off[3 * k + m];
      out->sought[3 * i + m] = sought[3 * k + m], out->equal[3 * i + m] = equal[3 * k + m];
    }
  }
  const int code = tl_envelope_of(s, rows, out->n, &out->g);
  if (code) return code;
  double most = 0.0;
  for (size_t i = 0; i < count; i++) {
    const int k = (int)(i / 3);
    const double *own = tl_block_at(&out->g, out->g.lower, k, k) + (i % 3) * (tl_row_length(&out->g, k) + 1);
    out->size[i] = tl_larger(*own, 1e-300);
    if (out->sought[i]) most = tl_larger(most, out->size[i]);
  }
  for (size_t i = 0; i < count; i++) out->regular[i] = TL_REGULAR * most + (i % 3 < 2 ? SOFT * out->size[i] : 0.0);
  out->matrix = out->g;
  out->matrix.lower = tl_take(&s->work, 9 * out->g.at[out->n], sizeof(double));
  out->matrix.upper = tl_take(&s->work, 9 * out->g.at[out->n], sizeof(double));
  return out->matrix.lower && out->matrix.upper ? TL_FINE : TL_NO_MEMORY;
}

/* nu of the rows that press: (G + regular) nu = -off. 0 where the matrix is singular. */
static int solve_pressing(int level, rows_of_positions *r) {
  for (int i = 0; i < r->n; i++) {
    const int first = 3 * r->g.first[i], count = 3 * (i + 1) - first;
    const uint8_t *pressing = r->pressing + first;
    for (int a = 0; a < 3; a++) {
      const size_t at = 9 * r->g.at[i] + (size_t)(a * count);
      const double *g = r->g.lower + at;
      double *lower = r->matrix.lower + at, *upper = r->matrix.upper + at;
      for (int k = 0; k < count; k++) lower[k] = upper[k] = r->pressing[3 * i + a] && pressing[k] ? g[k] : 0.0;
      lower[count - 3 + a] += r->pressing[3 * i + a] ? r->regular[3 * i + a] : 1.0;
    }
  }
  for (int i = 0; i < 3 * r->n; i++) r->nu[i] = r->pressing[i] ? -r->off[i] : 0.0;
  if (!tl_factor_envelope(level, &r->matrix)) return 0;
  tl_solve_envelope(level, &r->matrix, r->nu);
  return 1;
}

/* nu by the contact problem without friction, whose tangents are not coupled. */
static int solve_as_contacts(tl_scene *s, rows_of_positions *r) {
  tl_problem problem = {.g = r->g, .b = r->u, .mu = r->size};
  tl_answer answer;
  for (int i = 0; i < r->n; i++) {
    for (int j = r->g.first[i]; j <= i; j++) {
      double *at = tl_block_at(&r->g, r->g.lower, i, j), g[9];
      const size_t apart = tl_row_length(&r->g, i);
      const int both = r->sought[3 * i + 2] && r->sought[3 * j + 2];
      tl_get_block(at, apart, g);
      const double normal = both ? g[8] : 0.0;
      memset(g, 0, sizeof g);
      g[8] = i == j && !both ? 1.0 : normal;
      if (i == j) g[0] = g[4] = 1.0;
      tl_set_block(at, apart, g);
    }
    problem.b[3 * i] = problem.b[3 * i + 1] = 0.0, problem.b[3 * i + 2] = r->sought[3 * i + 2] ? r->off[3 * i + 2] : 0.0;
    problem.mu[i] = 0.0;
  }
  memset(r->nu, 0, (size_t)r->n * 3 * sizeof(double));
  int code = tl_problem_sizes(s, &problem);
  if (!code) code = tl_solve_impulses(s, &problem, r->nu, &answer);
  for (int i = 0; i < 3 * r->n; i++)
    if (!r->sought[i]) r->nu[i] = 0.0;
  return code ? code : answer.residual <= TL_EXACT ? TL_FINE : TL_HALVE;
}

/* nu with 0 <= nu and 0 <= G nu + off, one of them 0, of what is no equation: the set that presses is solved for until it stays
(Hintermueller, Ito, Kunisch, SIAM J. Optim. 13 (2002) 865-888), see `solve_normal`. */
static int solve_normal(tl_scene *s, rows_of_positions *r) {
  const int count = 3 * r->n;
  int any = 0;
  for (int i = 0; i < count; i++) {
    any |= r->equal[i];
    r->pressing[i] = r->sought[i] && (r->equal[i] || r->off[i] < 0.0);
  }
  for (int round = 0; round < SETS; round++) {
    int changed = 0;
    if (!solve_pressing(s->level, r)) return TL_HALVE;
    tl_envelope_times(s->level, &r->g, r->nu, r->u);
    for (int i = 0; i < count; i++) {
      const int now = r->sought[i] && (r->equal[i] || r->nu[i] - (r->u[i] + r->off[i]) / r->size[i] > 0.0);
      changed |= now != r->pressing[i];
      r->pressing[i] = (uint8_t)now;
    }
    if (!changed) return TL_FINE;
  }
  return any ? TL_HALVE : solve_as_contacts(s, r);
}

/* dq (nv) of the rows that are sought. */
static int push_of(tl_scene *s, const tl_law *law, const double *off, const uint8_t *sought, const uint8_t *equal, double *push) {
  rows_of_positions r;
  uint8_t *marked = law->taken;
  for (int k = 0; k < law->n; k++) marked[k] = sought[3 * k] | sought[3 * k + 1] | sought[3 * k + 2];
  tl_place_of *order;
  int code = tl_in_order(s, law, marked, &order, &r.n);
  r.order = order;
  if (!code) code = new_rows(s, law, off, sought, equal, &r);
  if (!code) code = solve_normal(s, &r);
  if (code) return code;
  memset(push, 0, (size_t)s->nv * sizeof(double));
  for (int i = 0; i < r.n; i++) {
    const tl_row *row = law->rows + order[i].point;
    tl_add_row(row, row->y, r.nu + 3 * i, push);
  }
  tl_free_outward(s, push);
  return TL_FINE;
}

/* Whether there is nothing to remove. */
static int is_there(const tl_law *law, const double *off, const uint8_t *lasts) {
  for (int k = 0; k < law->n; k++) {
    for (int m = 0; m < 3; m++)
      if (lasts[3 * k + m] && !(fabs(off[3 * k + m]) < TL_CLOSED)) return 0;
    if (law->rests[k] && !lasts[3 * k + 2] && !(off[3 * k + 2] > -TL_CLOSED)) return 0;
  }
  return 1;
}

/* dq (nv), of slips and gaps (n, 3) and of directions (n, 3) in which contacts last; TL_HALVE where there is none. */
int tl_correction(tl_scene *s, const tl_law *law, const double *off, const uint8_t *lasts, double *push) {
  const size_t count = 3 * (size_t)law->n;
  memset(push, 0, (size_t)s->nv * sizeof(double));
  if (is_there(law, off, lasts)) return TL_FINE;
  uint8_t *equal = tl_take(&s->work, count, 1), *sought = tl_take(&s->work, count, 1);
  if (!equal || !sought) return TL_NO_MEMORY;
  memcpy(equal, lasts, count);
  for (int attempt = 0; attempt < 2; attempt++) {
    for (int k = 0; k < law->n; k++)
      for (int m = 0; m < 3; m++)
        sought[3 * k + m] = equal[3 * k + m] || (m == 2 && law->rests[k] && off[3 * k + 2] < 0.0);
    for (int round = 0; round < SETS; round++) {
      int missed = 0;
      const int code = push_of(s, law, off, sought, equal, push);
      if (code == TL_HALVE) break;
      if (code) return code;
      tl_speeds(s, law->points, law->rows, law->n, push, law->moves);
      for (int k = 0; k < law->n; k++)
        if (law->rests[k] && !sought[3 * k + 2] && off[3 * k + 2] + law->moves[3 * k + 2] < -TL_CLOSED)
          sought[3 * k + 2] = 1, missed = 1;
      if (!missed) return TL_FINE;
    }
    memset(equal, 0, count);
  }
  return TL_HALVE;
}
