/* Positions at the end of a step: the motion dq = M^-1 J^T nu that removes what velocities leave of gaps and of drift. Statement
and source: contact/positions.py.

Rows that are not sought or do not press have the equation nu = 0, so that a point always has a block of three. */
#include "step.h"
#include "vectors.h"

#define SOFT 1e-6 /* of G at a contact: slip yields to overlap where not both can be removed */
#define ROUNDING 1e-14 /* of what is off */
enum { SETS = 40, REFINED = 4 };

/* The rows (3n) of points: gaps and slips, what is sought, what is an equation, what presses, the size of G and what makes it
regular, and nu. */
typedef struct {
  int n;
  tl_system g;
  double *off, *size, *regular, *nu, *u, *rest;
  uint8_t *sought, *equal, *pressing;
} rows_of_positions;

static int new_rows(tl_scene *s, const tl_law *law, const tl_place_of *order, const double *off, const uint8_t *sought,
                    const uint8_t *equal, rows_of_positions *out) {
  const size_t count = 3 * (size_t)out->n;
  const tl_row **rows = tl_take(&s->work, (size_t)out->n, sizeof *rows);
  double *x = tl_take(&s->work, 6 * count, sizeof(double)), most = 0.0;
  uint8_t *marks = tl_take(&s->work, 3 * count, 1);
  if (!rows || !x || !marks) return TL_NO_MEMORY;
  double **const parts[6] = {&out->off, &out->size, &out->regular, &out->nu, &out->u, &out->rest};
  for (int k = 0; k < 6; k++) *parts[k] = x + count * (size_t)k;
  out->sought = marks, out->equal = marks + count, out->pressing = marks + 2 * count;
  for (int i = 0; i < out->n; i++) {
    const int k = order[i].point, code = tl_need_row(s, law->points + k, law->rows + k);
    if (code) return code;
    rows[i] = law->rows + k;
    tl_copy3(off + 3 * k, out->off + 3 * i);
    memcpy(out->sought + 3 * i, sought + 3 * k, 3);
    memcpy(out->equal + 3 * i, equal + 3 * k, 3);
  }
  const int code = tl_new_system(s, rows, NULL, out->n, out->n, &out->g);
  if (code) return code;
  for (int i = 0; i < out->n; i++) tl_system_diagonal(&out->g, i, out->size + 3 * i);
  for (size_t i = 0; i < count; i++) {
    out->size[i] = tl_larger(out->size[i], 1e-300);
    if (out->sought[i]) most = tl_larger(most, out->size[i]);
  }
  for (size_t i = 0; i < count; i++) out->regular[i] = TL_REGULAR * most + (i % 3 < 2 ? SOFT * out->size[i] : 0.0);
  return TL_FINE;
}

/* What nu misses of the equations, of which rows that do not press have none: the largest. */
static double miss(int level, rows_of_positions *r) {
  double most = 0.0;
  tl_system_times(level, &r->g, r->nu, r->u);
  for (int i = 0; i < 3 * r->n; i++) {
    r->rest[i] = r->pressing[i] ? -r->off[i] - r->u[i] - r->regular[i] * r->nu[i] : 0.0;
    most = tl_larger(most, fabs(r->rest[i]));
  }
  return most;
}

/* nu of the rows that press: (G + regular) nu = -off, refined until no more than rounding is missed. 0 where the matrix is
singular. */
static int solve_pressing(int level, rows_of_positions *r) {
  for (int i = 0; i < 3 * r->n; i++) {
    double *inverse = r->g.inverse + 3 * i, *coupling = r->g.coupling + 3 * i;
    memset(inverse, 0, 3 * sizeof(double));
    memset(coupling, 0, 3 * sizeof(double));
    inverse[i % 3] = r->pressing[i] ? 1.0 / r->regular[i] : 1.0;
    coupling[i % 3] = r->pressing[i] ? inverse[i % 3] : 0.0;
    r->nu[i] = 0.0;
  }
  if (!tl_factor_system(level, &r->g)) return 0;
  double first = 0.0;
  for (int round = 0; round < REFINED; round++) {
    const double most = miss(level, r);
    if (!round) first = most;
    else if (most <= ROUNDING * first) break;
    tl_solve_system(level, &r->g, r->rest);
    for (int i = 0; i < 3 * r->n; i++) r->nu[i] += r->rest[i];
  }
  return 1;
}

/* nu by the contact problem without friction, of the normals that are sought alone. */
static int solve_as_contacts(tl_scene *s, rows_of_positions *r) {
  tl_problem problem = {.g = r->g, .b = r->u, .mu = r->size};
  tl_answer answer;
  for (int i = 0; i < r->n; i++) {
    for (int m = r->g.first[i]; m < r->g.first[i + 1]; m++)
      memset(r->g.y + TL_PART * (size_t)m, 0, (r->sought[3 * i + 2] ? 2u : 3u) * TL_LANES * sizeof(double));
    problem.b[3 * i] = problem.b[3 * i + 1] = 0.0, problem.b[3 * i + 2] = r->sought[3 * i + 2] ? r->off[3 * i + 2] : 0.0;
    problem.mu[i] = 0.0;
  }
  memset(r->nu, 0, (size_t)r->n * 3 * sizeof(double));
  int code = tl_problem_sizes(s, &problem);
  if (!code) code = tl_solve_impulses(s, &problem, r->nu, &answer);
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
    tl_system_times(s->level, &r->g, r->nu, r->u);
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
  if (!code) code = new_rows(s, law, order, off, sought, equal, &r);
  if (!code) code = solve_normal(s, &r);
  if (code) return code;
  memset(push, 0, (size_t)s->nv * sizeof(double));
  for (int i = 0; i < r.n; i++) {
    const tl_row *row = law->rows + order[i].point;
    tl_add_row(row, row->y, r.nu + 3 * i, push);
  }
  tl_outward(s, push);
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
        sought[3 * k + m] = equal[3 * k + m] || (m == 2 && law->rests[k] && off[3 * k + 2] < -TL_CLOSED);
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
