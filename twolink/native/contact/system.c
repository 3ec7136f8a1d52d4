/* What equations of contacts are made of: nodes of up to six degrees of freedom, the order in which they are eliminated, and
which blocks their factors have. See blocks.c.

The node with the fewest neighbours comes next, and its neighbours become neighbours of each other (Tinney, Walker, Proc. IEEE
55 (1967) 1801-1809). Neighbours are bits: 500 bodies are 32 kB. */
#include "solver.h"
#include "vectors.h"

typedef uint64_t word;
enum { BITS = 64 };

/* Degrees of freedom in nodes: number (nv) of each times TL_LANES, with its place; -1 at first. */
static int number_of(const tl_scene *s, int d, int32_t *number, int32_t *open, int *nodes) {
  int32_t *last = open + s->body[s->dof_body[d]].tree; /* the place behind the last one of the tree */
  if (number[d] >= 0) return number[d];
  if (*last % TL_LANES == 0) *last = TL_LANES * (*nodes)++;
  number[d] = *last;
  *last += (*last + 1) % TL_LANES == TL_NODE ? TL_LANES - TL_NODE + 1 : 1;
  return number[d];
}

/* The parts of rows at nodes: of each block its own, one after the other. Counts them where `y` is not there. */
static int parts_of(const tl_scene *s, const tl_row *const *rows, const tl_place_in *places, int n, int32_t *number,
                    int32_t *open, tl_system *out) {
  int parts = -1, block = -1;
  for (int i = 0; i < n; i++) {
    const tl_place_in place = places ? places[i] : (tl_place_in){i, 0, -1};
    int last = -1;
    for (; block < place.block; block++)
      if (out->y) out->first[block + 1] = parts + 1;
    for (int k = 0; k < rows[i]->count; k++) {
      const int d = rows[i]->dof[k], at = number_of(s, d, number, open, &out->nodes), node = at / TL_LANES;
      if (node != last) last = node, parts++;
      if (!out->y) continue;
      double *y = out->y + TL_PART * (size_t)parts + at % TL_LANES;
      out->node[parts] = node;
      if (place.own >= 0) y[TL_LANES * place.row] = rows[i]->y[3 * k + place.own];
      else
        for (int r = 0; r < 3; r++) y[TL_LANES * r] = rows[i]->y[3 * k + r];
    }
  }
  if (out->y) out->first[block + 1] = parts + 1;
  return parts + 1;
}

static int count_bits(const word *row, size_t words) {
  int count = 0;
  for (size_t k = 0; k < words; k++) count += __builtin_popcountll(row[k]);
  return count;
}

static int has(const word *row, int k) { return (int)(row[k / BITS] >> (k % BITS) & 1); }

static void set(word *row, int k) { row[k / BITS] |= (word)1 << (k % BITS); }

static void clear(word *row, int k) { row[k / BITS] &= ~((word)1 << (k % BITS)); }

/* The order of elimination. The rows of `near` become the neighbours that come later. */
static void eliminate(word *near, size_t words, int nodes, int32_t *degree, int32_t *order) {
  for (int k = 0; k < nodes; k++) degree[k] = count_bits(near + (size_t)k * words, words);
  for (int count = 0; count < nodes; count++) {
    int best = -1;
    for (int k = 0; k < nodes; k++)
      if (degree[k] >= 0 && (best < 0 || degree[k] < degree[best])) best = k;
    const word *own = near + (size_t)best * words;
    order[count] = best, degree[best] = -1;
    for (int k = 0; k < nodes; k++) {
      word *row = near + (size_t)k * words;
      if (!has(own, k)) continue;
      for (size_t m = 0; m < words; m++) row[m] |= own[m];
      clear(row, k), clear(row, best);
      degree[k] = count_bits(row, words);
    }
  }
}

/* The order of the nodes and the blocks of the factors. number (nodes): of each node its place in the order. */
static int shape(tl_scene *s, tl_system *out, int32_t *number) {
  const size_t nodes = (size_t)out->nodes, words = (nodes + BITS - 1) / BITS;
  word *near = tl_take(&s->work, nodes * words, sizeof(word));
  int32_t *order = tl_take(&s->work, 2 * nodes, sizeof(int32_t));
  out->start = tl_take(&s->work, nodes + 1, sizeof(int32_t));
  if (!near || !order || !out->start) return TL_NO_MEMORY;
  memset(near, 0, nodes * words * sizeof(word));
  for (int i = 0; i < out->points; i++)
    for (int a = out->first[i]; a < out->first[i + 1]; a++)
      for (int b = out->first[i]; b < out->first[i + 1]; b++)
        if (out->node[a] != out->node[b]) set(near + (size_t)out->node[a] * words, out->node[b]);
  eliminate(near, words, out->nodes, order + nodes, order);
  out->start[0] = 0;
  for (int k = 0; k < out->nodes; k++) {
    number[order[k]] = k;
    out->start[k + 1] = out->start[k] + count_bits(near + (size_t)order[k] * words, words);
  }
  out->below = tl_take(&s->work, (size_t)out->start[nodes], sizeof(int32_t));
  if (!out->below) return TL_NO_MEMORY;
  for (int k = 0; k < out->nodes; k++)
    for (int j = k + 1, at = out->start[k]; at < out->start[k + 1]; j++)
      if (has(near + (size_t)order[k] * words, order[j])) out->below[at++] = j;
  return TL_FINE;
}

/* Memory for the factors. */
static int take(tl_scene *s, tl_system *out) {
  const size_t nodes = (size_t)out->nodes, blocks = (size_t)out->start[out->nodes];
  int32_t *whole = tl_take(&s->work, (5 + TL_NODE) * nodes, sizeof(int32_t));
  out->x = tl_take(&s->work, 2 * TL_LANES * nodes, sizeof(double));
  out->own = tl_take(&s->work, TL_BLOCK * nodes, sizeof(double));
  out->lower = tl_take(&s->work, 2 * TL_BLOCK * blocks, sizeof(double));
  out->inverse = tl_take(&s->work, 18 * (size_t)out->points, sizeof(double));
  if (!whole || !out->x || !out->own || !out->lower || !out->inverse) return TL_NO_MEMORY;
  out->at = whole, out->next = whole + nodes, out->after = whole + 2 * nodes, out->waiting = whole + 3 * nodes;
  out->used = whole + 4 * nodes, out->order = whole + 5 * nodes;
  out->mass = out->x + TL_LANES * nodes, out->upper = out->lower + TL_BLOCK * blocks;
  out->coupling = out->inverse + 9 * out->points;
  memset(out->used, 0, nodes * sizeof(int32_t));
  for (size_t k = 0; k < TL_LANES * nodes; k++) out->mass[k] = 1.0;
  return TL_FINE;
}

/* Equations of rows with Y (n) in so many blocks; places: where each is, NULL: one after the other. */
int tl_new_system(tl_scene *s, const tl_row *const *rows, const tl_place_in *places, int n, int blocks, tl_system *out) {
  const size_t nv = (size_t)s->nv, bodies = (size_t)s->bodies;
  int32_t *number = tl_take(&s->work, nv + bodies, sizeof(int32_t)), *open = number + nv;
  *out = (tl_system){.points = blocks};
  if (!number) return TL_NO_MEMORY;
  for (size_t d = 0; d < nv; d++) number[d] = -1;
  memset(open, 0, bodies * sizeof(int32_t));
  const size_t parts = (size_t)parts_of(s, rows, places, n, number, open, out);
  int32_t *places_of_nodes = tl_take(&s->work, (size_t)out->nodes, sizeof(int32_t));
  out->first = tl_take(&s->work, (size_t)blocks + 1, sizeof(int32_t));
  out->node = tl_take(&s->work, parts, sizeof(int32_t));
  out->y = tl_take(&s->work, TL_PART * parts, sizeof(double));
  if (!places_of_nodes || !out->first || !out->node || !out->y) return TL_NO_MEMORY;
  memset(out->y, 0, TL_PART * parts * sizeof(double));
  parts_of(s, rows, places, n, number, open, out);
  int code = shape(s, out, places_of_nodes);
  if (!code) code = take(s, out);
  if (code) return code;
  for (size_t m = 0; m < parts; m++) out->node[m] = places_of_nodes[out->node[m]];
  for (size_t d = 0; d < nv; d++)
    if (number[d] >= 0) {
      const int32_t node = places_of_nodes[number[d] / TL_LANES];
      out->mass[TL_LANES * node + number[d] % TL_LANES] = 1.0 / s->inverse[d], out->used[node]++;
    }
  return TL_FINE;
}

/* The diagonal of G, of a point (3). */
void tl_system_diagonal(const tl_system *a, int i, double *out) {
  memset(out, 0, 3 * sizeof(double));
  for (int m = a->first[i]; m < a->first[i + 1]; m++)
    for (int k = 0; k < 3 * TL_LANES; k++) {
      const double y = a->y[TL_PART * (size_t)m + (size_t)k];
      out[k / TL_LANES] += y * y / a->mass[TL_LANES * a->node[m] + k % TL_LANES];
    }
}

/* Which code runs on which level of a processor, see machine.c. */
TL_DECLARE_SYSTEM(base)
#if defined(X86_LEVELS)
TL_DECLARE_SYSTEM(v3)
TL_DECLARE_SYSTEM(v4)
#define CALL(name, level, ...) \
  (level == 2 ? name##_v4(__VA_ARGS__) : level == 1 ? name##_v3(__VA_ARGS__) : name##_base(__VA_ARGS__))
#else
#define CALL(name, level, ...) ((void)level, name##_base(__VA_ARGS__))
#endif

int tl_factor_system(int level, const tl_system *a) { return CALL(tl_factor_system, level, a); }

void tl_solve_system(int level, const tl_system *a, double *p) { CALL(tl_solve_system, level, a, p); }

void tl_system_times(int level, const tl_system *a, const double *p, double *out) { CALL(tl_system_times, level, a, p, out); }
