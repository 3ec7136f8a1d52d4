/* The contact problem of a step, island by island: bodies that no contact connects have problems of their own. The points of an
island stand as its bodies lie, so that envelopes are narrow.

Trees of bodies are the nodes of a graph, points between two of them its edges. They are numbered breadth first from a node as
far out as one search finds (Cuthill, McKee, Proc. 24th Nat. Conf. ACM (1969) 157-172; George, Liu, ACM Trans. Math. Softw. 5
(1979) 284-295). */
#include "step.h"
#include "vectors.h"

#include <stdlib.h>

#define CREATED 1e-6 /* of the energy that impulses take: what counts as created */
enum { ROUNDS = 20, HALVED = 10 };

/* The graph: the neighbours of tree b are near[from[b]] to near[from[b + 1]]. number: of each tree, -1 at first. */
typedef struct {
  int32_t *from, *near, *number, *island, *queue;
} graph;

static int compare(const void *a, const void *b) {
  const tl_place_of *x = a, *y = b;
  if (x->island != y->island) return x->island < y->island ? -1 : 1;
  if (x->rank != y->rank) return x->rank < y->rank ? -1 : 1;
  if (x->body != y->body) return x->body < y->body ? -1 : 1;
  return x->point < y->point ? -1 : x->point > y->point;
}

/* The trees of a point's bodies, 0 for the ground; its later body. */
static int trees_of(const tl_scene *s, const tl_point *point, int32_t *trees) {
  const int first = point->dof >= 0 ? s->dof_body[point->dof] : point->first;
  trees[0] = s->body[first].tree, trees[1] = s->body[point->second].tree;
  return first > point->second ? first : point->second;
}

/* The graph of the marked points. */
static int graph_of(tl_scene *s, const tl_law *law, const uint8_t *marked, graph *out) {
  const size_t bodies = (size_t)s->bodies;
  int32_t trees[2], *numbers = tl_take(&s->work, 4 * bodies + 1, sizeof(int32_t));
  if (!numbers) return TL_NO_MEMORY;
  out->number = numbers, out->island = numbers + bodies, out->queue = numbers + 2 * bodies, out->from = numbers + 3 * bodies;
  memset(out->from, 0, (bodies + 1) * sizeof(int32_t));
  for (int k = 0; k < law->n; k++) {
    if (!marked[k]) continue;
    trees_of(s, law->points + k, trees);
    if (trees[0] && trees[1] && trees[0] != trees[1]) out->from[trees[0]]++, out->from[trees[1]]++;
  }
  int32_t all = 0;
  for (size_t b = 0; b <= bodies; b++) {
    all += out->from[b];
    out->from[b] = all; /* the end, from which they are filled to the begin */
  }
  out->near = tl_take(&s->work, (size_t)all, sizeof(int32_t));
  if (!out->near) return TL_NO_MEMORY;
  for (int k = law->n - 1; k >= 0; k--) {
    if (!marked[k]) continue;
    trees_of(s, law->points + k, trees);
    if (!trees[0] || !trees[1] || trees[0] == trees[1]) continue;
    out->near[--out->from[trees[0]]] = trees[1];
    out->near[--out->from[trees[1]]] = trees[0];
  }
  return TL_FINE;
}

/* Number the trees that are connected with one, breadth first from a number on; the last of them. */
static int32_t search(graph *g, int32_t start, int32_t island, int32_t number, int32_t *count) {
  int32_t done = 0, size = 1;
  g->queue[0] = start, g->number[start] = number, g->island[start] = island;
  for (; done < size; done++)
    for (int32_t k = g->from[g->queue[done]]; k < g->from[g->queue[done] + 1]; k++) {
      const int32_t next = g->near[k];
      if (g->number[next] >= 0) continue;
      g->number[next] = number + size, g->island[next] = island, g->queue[size++] = next;
    }
  *count = size;
  return g->queue[size - 1];
}

/* Number all trees. */
static void number_trees(const tl_scene *s, graph *g) {
  int32_t number = 0, count = 0;
  for (int b = 0; b < s->bodies; b++) g->number[b] = -1;
  for (int b = 1; b < s->bodies; b++) {
    if (g->number[b] >= 0 || s->body[b].tree != b) continue;
    const int32_t far = search(g, b, b, number, &count);
    for (int32_t k = 0; k < count; k++) g->number[g->queue[k]] = -1;
    search(g, far, b, number, &count);
    number += count;
  }
}

/* The marked points in the order of their islands, and how many there are. */
int tl_in_order(tl_scene *s, const tl_law *law, const uint8_t *marked, tl_place_of **order, int *size) {
  graph g;
  int count = 0;
  for (int k = 0; k < law->n; k++) count += marked[k];
  tl_place_of *out = *order = tl_take(&s->work, (size_t)count, sizeof(tl_place_of));
  if (!out) return TL_NO_MEMORY;
  const int code = graph_of(s, law, marked, &g);
  if (code) return code;
  number_trees(s, &g);
  *size = count, count = 0;
  for (int k = 0; k < law->n; k++) {
    int32_t trees[2];
    if (!marked[k]) continue;
    const int later = trees_of(s, law->points + k, trees);
    const int32_t a = trees[0] ? trees[0] : trees[1], b = trees[1] ? trees[1] : trees[0];
    const int32_t rank = g.number[a] > g.number[b] ? g.number[a] : g.number[b];
    out[count++] = (tl_place_of){a ? g.island[a] : 0, a ? rank : 0, later, k};
  }
  qsort(out, (size_t)count, sizeof(tl_place_of), compare);
  return TL_FINE;
}

/* The rows of a joint's point that are 0 get the size of the one that is not, so that their impulses are 0; b gets the normal
impulse that is given. See `complete` of contact/joints.py. */
static void complete(tl_problem *problem, int i, double given) {
  double *at = tl_block_at(&problem->g, problem->g.lower, i, i), own[9];
  const size_t apart = tl_row_length(&problem->g, i);
  tl_get_block(at, apart, own);
  const double size = tl_larger(own[0], tl_larger(own[4], own[8]));
  own[0] = own[4] = own[8] = size;
  tl_set_block(at, apart, own);
  problem->b[3 * i + 2] -= size * given;
}

/* What the velocity along the normal is to exceed, against its sign: what a gap leaves open, or bounces give. */
static double limit_of(const tl_law *law, int k) {
  return law->bounces[k] ? -law->share * law->rebound[k] : law->open[k];
}

/* The problem of points active[begin..end): G, b and friction. */
static int problem_of(tl_scene *s, const tl_law *law, const int32_t *active, int n, tl_problem *out) {
  const tl_row **rows = tl_take(&s->work, (size_t)n, sizeof *rows);
  out->b = tl_take(&s->work, 3 * (size_t)n, sizeof(double));
  out->mu = tl_take(&s->work, (size_t)n, sizeof(double));
  if (!rows || !out->b || !out->mu) return TL_NO_MEMORY;
  for (int i = 0; i < n; i++) {
    const int k = active[i], code = tl_need_row(s, law->points + k, law->rows + k);
    if (code) return code;
    rows[i] = law->rows + k;
    tl_copy3(law->after + 3 * k, out->b + 3 * i);
    out->b[3 * i + 2] += limit_of(law, k);
    out->mu[i] = law->mu[k];
  }
  const int code = tl_envelope_of(s, rows, n, &out->g);
  if (code) return code;
  for (int i = 0; i < n; i++)
    if (law->of_joints[active[i]]) complete(out, i, law->given[active[i]]);
  return tl_problem_sizes(s, out);
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
  tl_free_outward(s, found->ends);
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
    tl_problem problem;
    tl_answer answer;
    for (end = first + 1; end < found->count && order[end].island == order[first].island;) end++;
    int code = problem_of(s, law, found->active + first, end - first, &problem);
    if (code) return code;
    problem.scale = tl_larger(problem.scale, scale);
    double *p = found->p + 3 * first, *u = found->u + 3 * first;
    for (int i = first; i < end; i++) tl_copy3(law->guess + 3 * found->active[i], found->p + 3 * i);
    code = tl_solve_impulses(s, &problem, p, &answer);
    if (code) return code;
    add_answer(&found->answer, &answer);
    if (!(answer.residual <= TL_EXACT)) return TL_HALVE;
    tl_envelope_times(s->level, &problem.g, p, u);
    for (int i = 0; i < 3 * (end - first); i++) u[i] += problem.b[i];
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
