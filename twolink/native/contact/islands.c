/* The contact problem of a step, island by island: bodies that no contact connects have problems of their own. */
#include "step.h"
#include "vectors.h"

#include <stdlib.h>

#define CREATED 1e-6 /* of the energy that impulses take: what counts as created */
enum { ROUNDS = 20, HALVED = 10 };

static int compare(const void *a, const void *b) {
  const tl_place_of *x = a, *y = b;
  if (x->island != y->island) return x->island < y->island ? -1 : 1;
  if (x->body != y->body) return x->body < y->body ? -1 : 1;
  return x->point < y->point ? -1 : x->point > y->point;
}

/* The trees of a point's bodies, 0 for the ground; its later body. */
static int trees_of(const tl_scene *s, const tl_point *point, int32_t *trees) {
  const int first = point->dof >= 0 ? s->dof_body[point->dof] : point->first;
  trees[0] = s->body[first].tree, trees[1] = s->body[point->second].tree;
  return first > point->second ? first : point->second;
}

/* The first tree of those that are connected with a tree, see `tl_in_order`. */
static int32_t first_of(int32_t *up, int32_t tree) {
  while (up[tree] != tree) tree = up[tree] = up[up[tree]];
  return tree;
}

/* The marked points in the order of their islands, and how many there are. Trees of bodies that a point connects have the same
first tree (union by halved paths: Tarjan, van Leeuwen, J. ACM 31 (1984) 245-281). */
int tl_in_order(tl_scene *s, const tl_law *law, const uint8_t *marked, tl_place_of **order, int *size) {
  int32_t trees[2], *up = tl_take(&s->work, (size_t)s->bodies, sizeof(int32_t));
  tl_place_of *out = *order = tl_take(&s->work, (size_t)law->n, sizeof(tl_place_of));
  int count = 0;
  if (!up || !out) return TL_NO_MEMORY;
  for (int b = 0; b < s->bodies; b++) up[b] = b;
  for (int k = 0; k < law->n; k++) {
    if (!marked[k]) continue;
    const int later = trees_of(s, law->points + k, trees);
    const int32_t a = first_of(up, trees[0]), b = first_of(up, trees[1]);
    if (a && b) up[a > b ? a : b] = a < b ? a : b;
    out[count++] = (tl_place_of){a ? a : b, later, k};
  }
  for (int i = 0; i < count; i++) out[i].island = first_of(up, out[i].island);
  qsort(out, (size_t)count, sizeof(tl_place_of), compare);
  *size = count;
  return TL_FINE;
}

/* The blocks of points: of each contact its own, of up to three joints' points that follow each other one. */
static int place_in_blocks(const tl_law *law, const int32_t *active, int n, tl_place_in *places) {
  int count = 0, row = 3;
  for (int i = 0; i < n; i++) {
    const int k = active[i], of_joint = law->of_joints[k];
    if (!of_joint || row == 3) count++, row = 0;
    places[i] = (tl_place_in){count - 1, of_joint ? row++ : 0, !of_joint ? -1 : law->given[k] > 0.0 ? 0 : 2};
    if (!of_joint) row = 3;
  }
  return count;
}

/* What the velocity along the normal is to exceed, against its sign: what a gap leaves open, or bounces give. */
static double limit_of(const tl_law *law, int k) {
  return law->bounces[k] ? -law->share * law->rebound[k] : law->open[k];
}

/* b, friction and bounds of a point. */
static void law_of(const tl_law *law, int k, const tl_place_in *place, tl_problem *out) {
  double *b = out->b + 3 * place->block, *bounds = out->bounds + 6 * place->block + 2 * place->row;
  const double *after = law->after + 3 * k;
  if (!law->of_joints[k]) {
    tl_copy3(after, b);
    b[2] += limit_of(law, k);
    out->mu[place->block] = law->mu[k];
    return;
  }
  const double most = law->mu[k] * law->given[k];
  b[place->row] = after[place->own] + (place->own == 2 ? limit_of(law, k) : 0.0);
  out->mu[place->block] = -1.0;
  bounds[0] = place->own == 2 ? 0.0 : -most, bounds[1] = place->own == 2 ? INFINITY : most;
}

/* The problem of points (n) in so many blocks: G, b and the laws. */
static int problem_of(tl_scene *s, const tl_law *law, const int32_t *active, int n, const tl_place_in *places, int blocks,
                      tl_problem *out) {
  const tl_row **rows = tl_take(&s->work, (size_t)n, sizeof *rows);
  out->b = tl_take(&s->work, 10 * (size_t)blocks, sizeof(double));
  if (!rows || !out->b) return TL_NO_MEMORY;
  memset(out->b, 0, 10 * (size_t)blocks * sizeof(double));
  out->bounds = out->b + 3 * blocks, out->mu = out->b + 9 * blocks;
  for (int i = 0; i < n; i++) {
    const int k = active[i], code = tl_need_row(s, law->points + k, law->rows + k);
    if (code) return code;
    rows[i] = law->rows + k;
    law_of(law, k, places + i, out);
  }
  const int code = tl_new_system(s, rows, places, n, blocks, &out->g);
  return code ? code : tl_problem_sizes(s, out);
}

/* The impulses of the points (n) of an island, or their velocities, in its blocks; and back, those of other rows 0. */
static void to_blocks(const tl_law *law, const int32_t *active, int n, const tl_place_in *places, const double *x, double *out) {
  for (int i = 0; i < n; i++) {
    double *to = out + 3 * places[i].block;
    if (law->of_joints[active[i]]) to[places[i].row] = x[3 * active[i] + places[i].own];
    else tl_copy3(x + 3 * active[i], to);
  }
}

static void from_blocks(const tl_law *law, const int32_t *active, int n, const tl_place_in *places, const double *x, double *out) {
  memset(out, 0, 3 * (size_t)n * sizeof(double));
  for (int i = 0; i < n; i++) {
    const double *from = x + 3 * places[i].block;
    if (law->of_joints[active[i]]) out[3 * i + places[i].own] = from[places[i].row];
    else tl_copy3(from, out + 3 * i);
  }
}

/* The impulses of the points of an island, and what they leave, U + c. */
static int solve_island(tl_scene *s, const tl_law *law, const int32_t *active, int n, double scale, double *p, double *u,
                        tl_answer *answer) {
  tl_problem problem;
  tl_place_in *places = tl_take(&s->work, (size_t)n, sizeof *places);
  if (!places) return TL_NO_MEMORY;
  const int blocks = place_in_blocks(law, active, n, places), size = 3 * blocks;
  double *x = tl_take(&s->work, 2 * (size_t)size, sizeof(double));
  if (!x) return TL_NO_MEMORY;
  double *left = x + size;
  int code = problem_of(s, law, active, n, places, blocks, &problem);
  if (code) return code;
  problem.scale = tl_larger(problem.scale, scale);
  memset(x, 0, (size_t)size * sizeof(double));
  to_blocks(law, active, n, places, law->guess, x);
  code = tl_solve_impulses(s, &problem, x, answer);
  if (code) return code;
  tl_system_times(s->level, &problem.g, x, left);
  for (int i = 0; i < size; i++) left[i] += problem.b[i];
  from_blocks(law, active, n, places, x, p);
  from_blocks(law, active, n, places, left, u);
  for (int i = 0; i < n; i++)
    if (law->given[active[i]] > 0.0) p[3 * i + 2] = law->given[active[i]];
  return TL_FINE;
}

/* The worse of two answers. */
static void add_answer(tl_answer *all, const tl_answer *one) {
  all->residual = one->residual <= all->residual ? all->residual : one->residual;
  all->feasibility = tl_larger(all->feasibility, one->feasibility);
  all->complementarity = tl_larger(all->complementarity, one->complementarity);
  if (one->solver > all->solver) all->solver = one->solver;
}

/* v+ = free + M^-1 J^T P (nv). */
static void velocities_after(tl_scene *s, const tl_law *law, const double *free, tl_solution *found) {
  memset(found->ends, 0, (size_t)s->nv * sizeof(double));
  for (int i = 0; i < found->count; i++) {
    const tl_row *row = law->rows + found->active[i];
    tl_add_row(row, row->y, found->p + 3 * i, found->ends);
  }
  tl_outward(s, found->ends);
  for (int d = 0; d < s->nv; d++) found->ends[d] += free[d];
}

/* The impulses of what is active, by islands. */
static int solve_islands(tl_scene *s, tl_law *law, const tl_place_of *order, tl_solution *found) {
  double scale = 1.0;
  found->answer = (tl_answer){0, 0, 0, TL_NEWTON};
  for (int i = 0; i < found->count; i++) {
    const int k = found->active[i];
    for (int m = 0; m < 2; m++) scale = tl_larger(scale, fabs(law->after[3 * k + m]));
    scale = tl_larger(scale, fabs(law->after[3 * k + 2] + limit_of(law, k)));
  }
  for (int first = 0, end; first < found->count; first = end) {
    tl_answer answer;
    for (end = first + 1; end < found->count && order[end].island == order[first].island;) end++;
    const int code = solve_island(s, law, found->active + first, end - first, scale, found->p + 3 * first,
                                  found->u + 3 * first, &answer);
    if (code) return code;
    add_answer(&found->answer, &answer);
    if (!(answer.residual <= TL_EXACT)) return TL_HALVE;
  }
  return TL_FINE;
}

/* The impulses that obey the laws, with all points active that end too low without. */
int tl_solve_law(tl_scene *s, tl_law *law, const double *free, tl_solution *out) {
  for (int round = 0; round < ROUNDS; round++) {
    tl_place_of *order;
    int code = tl_in_order(s, law, law->active, &order, &out->count);
    if (code) return code;
    const int count = out->count;
    out->active = tl_take(&s->work, (size_t)count, sizeof(int32_t));
    out->p = tl_take(&s->work, 6 * (size_t)count, sizeof(double));
    out->ends = tl_take(&s->work, (size_t)s->nv, sizeof(double));
    if (!out->active || !out->p || !out->ends) return TL_NO_MEMORY;
    out->u = out->p + 3 * count, out->bounces = 0;
    for (int i = 0; i < count; i++) {
      out->active[i] = order[i].point;
      out->bounces |= law->bounces[order[i].point];
    }
    code = solve_islands(s, law, order, out);
    if (code) return code;
    for (int i = 0; i < count; i++) tl_copy3(out->p + 3 * i, law->guess + 3 * out->active[i]);
    velocities_after(s, law, free, out);
    if (!tl_missed(s, law, out)) return TL_FINE;
  }
  return TL_HALVE;
}

/* The work of the impulses, P . (U- + U+) / 2 when they act, as a share of what they take. */
static double gain(const tl_law *law, const tl_solution *found) {
  double work = 0.0, taken = 0.0;
  for (int i = 0; i < found->count; i++) {
    const int k = found->active[i];
    double u[3];
    tl_row_times(law->rows + k, found->ends, u);
    for (int m = 0; m < 3; m++) {
      work += found->p[3 * i + m] * (law->sums[3 * k + m] + u[m]);
      taken += fabs(found->p[3 * i + m] * law->before[3 * k + m]);
    }
  }
  return work / tl_larger(taken, 1e-300);
}

/* As `tl_solve_law`: bodies bounce by as much of their restitution as creates no energy, see `StepLaw.without_gain`. */
int tl_without_gain(tl_scene *s, tl_law *law, const double *free, tl_solution *out) {
  double least = 0.0, most = 1.0;
  tl_solution none, other;
  int code = tl_solve_law(s, law, free, out);
  if (code || !out->bounces || gain(law, out) <= CREATED) return code;
  law->share = 0.0;
  code = tl_solve_law(s, law, free, &none);
  law->share = 1.0;
  if (code == TL_HALVE) return TL_FINE;
  if (code) return code;
  const double limit = tl_larger(CREATED, gain(law, &none)); /* contacts that stick have a work too */
  if (gain(law, out) <= limit) return TL_FINE;
  *out = none;
  for (int k = 0; k < HALVED; k++) {
    const double middle = law->share = 0.5 * (least + most);
    code = tl_solve_law(s, law, free, &other);
    if (code > 0) return code;
    if (code == TL_HALVE || gain(law, &other) > limit) most = middle;
    else least = middle, *out = other;
  }
  law->share = least;
  return TL_FINE;
}
