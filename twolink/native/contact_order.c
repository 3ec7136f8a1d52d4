/* The order of points in a contact problem: island by island, and within one as its bodies lie, so that envelopes are narrow.

Trees of bodies are the nodes of a graph, points between two of them its edges. They are numbered breadth first from a node as
far out as one search finds (Cuthill, McKee, Proc. 24th Nat. Conf. ACM (1969) 157-172; George, Liu, ACM Trans. Math. Softw. 5
(1979) 284-295). */
#include "contact_law.h"
#include "contact_vectors.h"

#include <stdlib.h>

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
