/* Making scenes: every index is checked once here, so that steps need no checks. */
#include "scene.h"
#include "vectors.h"

#include <stdlib.h>

enum { SIZES = 16, MOST = 10000000, SMALL = 1 << 16, LARGE = 1 << 24 };

/* The arrays that a scene is made of, read from front to back. failed: more was asked for than there is. */
typedef struct {
  const int32_t *whole;
  const double *number;
  int64_t wholes, numbers;
  int failed;
} reader;

static int next_whole(reader *r) {
  if (r->wholes < 1) return r->failed = 1, 0;
  return r->wholes--, *r->whole++;
}

static void next_numbers(reader *r, double *out, int count) {
  if (r->numbers < count) {
    r->failed = 1;
    memset(out, 0, (size_t)count * sizeof(double));
    return;
  }
  memcpy(out, r->number, (size_t)count * sizeof(double));
  r->number += count, r->numbers -= count;
}

static double next_number(reader *r) {
  double out;
  next_numbers(r, &out, 1);
  return out;
}

/* A whole number from low to below high. */
static int next_index(reader *r, int low, int high) {
  const int out = next_whole(r);
  if (out >= low && out < high) return out;
  r->failed = 1;
  return low;
}

/* Zeros that the scene owns; NULL, and `failed`, without memory. All that it owns is a list. */
static void *own(tl_scene *s, reader *r, size_t count, size_t bytes) {
  void **memory = count < ((size_t)1 << 40) ? calloc(count * bytes + 16, 1) : NULL;
  if (!memory) {
    r->failed = 2;
    return NULL;
  }
  memory[0] = s->owned, s->owned = memory;
  return memory + 2;
}

static double *own_numbers(tl_scene *s, reader *r, int count) {
  double *out = r->failed ? NULL : own(s, r, (size_t)count, sizeof(double));
  if (out) next_numbers(r, out, count);
  return out;
}

/* Whole numbers from low to below high. */
static int32_t *own_indices(tl_scene *s, reader *r, int count, int low, int high) {
  int32_t *out = r->failed ? NULL : own(s, r, (size_t)count, sizeof(int32_t));
  for (int i = 0; out && i < count; i++) out[i] = next_index(r, low, high);
  return out;
}

/* Bodies, and the tree of their degrees of freedom. */
static void read_bodies(tl_scene *s, reader *r) {
  static const int ENTRIES[TL_JOINT_KINDS] = {7, 4, 4, 1, 2, 1}, DOFS[TL_JOINT_KINDS] = {6, 3, 3, 1, 1, 1};
  int dofs = 0, entries = 0;
  int32_t *last = own(s, r, (size_t)s->bodies, sizeof(int32_t));
  if (r->failed) return;
  next_numbers(r, s->gravity, 3);
  last[0] = -1;
  for (int b = 1; b < s->bodies && !r->failed; b++) {
    tl_body *body = s->body + b;
    body->kind = next_index(r, 0, TL_JOINT_KINDS), body->parent = next_index(r, 0, b);
    body->q = next_index(r, 0, s->nq), body->v = next_index(r, 0, s->nv), body->dofs = DOFS[body->kind];
    body->tree = body->parent ? s->body[body->parent].tree : b;
    if (body->q != entries || body->v != dofs || body->v + body->dofs > s->nv || body->q + ENTRIES[body->kind] > s->nq) {
      r->failed = 1; /* joints follow each other in q and in the velocity */
      return;
    }
    dofs += body->dofs, entries += ENTRIES[body->kind], last[b] = last[body->parent];
    for (int d = body->v; d < body->v + body->dofs; d++) {
      s->dof_parent[d] = last[b], s->dof_body[d] = b;
      s->dof_depth[d] = last[b] < 0 ? 0 : s->dof_depth[last[b]] + 1;
      last[b] = d;
    }
    next_numbers(r, body->axis, 3);
    next_numbers(r, body->rotation, 9);
    next_numbers(r, body->origin, 3);
    body->mass = next_number(r);
    next_numbers(r, body->centre, 3);
    next_numbers(r, body->inertia, 9);
    body->extent = next_number(r);
  }
  if (dofs != s->nv || entries != s->nq) r->failed = 1;
}

/* What bodies work with. */
static void own_places(tl_scene *s, reader *r) {
  const size_t bodies = (size_t)s->bodies, nv = (size_t)s->nv;
  double **const vectors[7] = {&s->origin, &s->linear, &s->angular, &s->acceleration, &s->turning, &s->force, &s->moment};
  size_t size = 0;
  for (size_t d = 0; d < nv; d++) s->factor_at[d] = size, size += (size_t)s->dof_depth[d] + 1;
  for (int k = 0; k < 7; k++) *vectors[k] = own(s, r, 3 * bodies, sizeof(double));
  s->turned = own(s, r, 9 * bodies, sizeof(double));
  s->composite = own(s, r, 10 * bodies, sizeof(double));
  s->along = own(s, r, 3 * nv, sizeof(double));
  s->about = own(s, r, 3 * nv, sizeof(double));
  s->factor = own(s, r, size, sizeof(double));
  s->inverse = own(s, r, nv, sizeof(double));
  s->input = own(s, r, 1 + (size_t)s->nq + nv + (size_t)s->numbers, sizeof(double));
  s->heights = own(s, r, (size_t)s->balls, sizeof(double));
  if (!r->failed) s->turned[0] = s->turned[4] = s->turned[8] = 1.0;
}

static void read_planes(tl_scene *s, reader *r) {
  s->feature = own_indices(s, r, s->balls, 0, INT32_MAX);
  for (int k = 0; k < 3; k++) s->ball[k] = own_numbers(s, r, s->balls);
  s->radius = own_numbers(s, r, s->balls);
  for (int k = 0; k < s->on_planes && !r->failed; k++) {
    tl_on_plane *one = s->on_plane + k;
    one->pair = next_index(r, 0, s->pairs), one->body = next_index(r, 0, s->bodies);
    one->first = next_index(r, 0, s->balls + 1), one->end = next_index(r, one->first, s->balls + 1);
    next_numbers(r, one->normal, 3);
    one->height = next_number(r);
    next_numbers(r, one->centre, 3);
    one->bound = next_number(r);
  }
  for (int k = 0; k < s->rims && !r->failed; k++) {
    tl_rim *one = s->rim + k;
    one->pair = next_index(r, 0, s->pairs), one->body = next_index(r, 0, s->bodies);
    one->feature = next_index(r, 0, MOST);
    next_numbers(r, one->normal, 3);
    one->height = next_number(r);
    next_numbers(r, one->point, 3);
    next_numbers(r, one->axis, 3);
    one->radius = next_number(r);
  }
}

static void read_fields(tl_scene *s, reader *r) {
  for (int k = 0; k < s->fields && !r->failed; k++) {
    tl_field *one = s->field + k;
    for (int i = 0; i < 2; i++) one->count[i] = next_index(r, 2, SMALL);
    next_numbers(r, one->cell, 2);
    next_numbers(r, one->origin, 3);
    one->top = next_number(r);
    if (!(one->cell[0] > 0 && one->cell[1] > 0) || (int64_t)one->count[0] * one->count[1] > MOST) r->failed = 1;
    one->height = own_numbers(s, r, one->count[0] * one->count[1]);
    const int triangles = 2 * (one->count[0] - 1) * (one->count[1] - 1);
    one->marks = own_indices(s, r, one->count[0] * one->count[1], 0, 1 << 4);
    one->plane_of = own_indices(s, r, triangles, 0, triangles);
    for (int i = 0; i < one->count[0] && !r->failed; i++) /* ridges end on the grid */
      for (int m = 0; m < one->count[1]; m++)
        if (one->marks[i * one->count[1] + m] & ((i + 1 < one->count[0] ? 0 : 1 | 2) | (m + 1 < one->count[1] ? 0 : 1 | 4)))
          r->failed = 1;
  }
  for (int k = 0; k < s->on_fields && !r->failed; k++) {
    tl_on_field *one = s->on_field + k;
    one->kind = next_index(r, 0, TL_FIELD_SHAPES), one->pair = next_index(r, 0, s->pairs);
    one->body = next_index(r, 0, s->bodies), one->field = next_index(r, 0, s->fields);
    if (one->kind == TL_HULL) one->solid = next_index(r, 0, s->solids);
    next_numbers(r, one->end[0], 6);
    one->radius = next_number(r);
  }
}

static void read_rounds(tl_scene *s, reader *r) {
  for (int k = 0; k < s->rounds && !r->failed; k++) {
    tl_round *one = s->round + k;
    one->kind = next_index(r, 0, TL_ROUND_KINDS), one->pair = next_index(r, 0, s->pairs);
    one->first = next_index(r, 0, s->bodies), one->second = next_index(r, 0, s->bodies);
    next_numbers(r, one->centre[0], 6);
    next_numbers(r, one->radius, 2);
    next_numbers(r, one->half[0], 6);
    next_numbers(r, one->axes, 9);
    next_numbers(r, one->edges, 3);
    one->bound = next_number(r);
    s->round_ends[2 * k] = one->first, s->round_ends[2 * k + 1] = one->second;
  }
}

static void read_hull(tl_scene *s, reader *r, tl_hull *hull) {
  hull->vertices = next_index(r, 4, MOST), hull->faces = next_index(r, 4, MOST);
  hull->edges = next_index(r, 6, MOST), hull->corners = next_index(r, 1, MOST);
  hull->edge = own_indices(s, r, 2 * hull->edges, 0, hull->vertices);
  hull->side = own_indices(s, r, 2 * hull->edges, 0, hull->faces);
  hull->start = own_indices(s, r, hull->faces + 1, 0, hull->corners + 1);
  hull->loop = own_indices(s, r, hull->corners, 0, hull->vertices);
  for (int f = 0; f < hull->faces && !r->failed; f++)
    if (hull->start[f] >= hull->start[f + 1]) r->failed = 1;
  hull->vertex = own_numbers(s, r, 3 * hull->vertices);
  hull->normal = own_numbers(s, r, 3 * hull->faces);
  hull->height = own_numbers(s, r, hull->faces);
  hull->way = own_numbers(s, r, 3 * hull->edges);
  hull->inward = own_numbers(s, r, 3 * hull->corners);
  hull->depth = own_numbers(s, r, hull->corners);
}

static void read_hulls(tl_scene *s, reader *r) {
  for (int k = 0; k < s->hulls && !r->failed; k++) read_hull(s, r, s->hull + k);
  for (int k = 0; k < s->solids && !r->failed; k++) {
    tl_solid *one = s->solid + k;
    one->body = next_index(r, 0, s->bodies), one->hull = next_index(r, 0, s->hulls);
    next_numbers(r, one->rotation, 9);
    next_numbers(r, one->origin, 3);
    one->bound = next_number(r);
    if (r->failed) return;
    const tl_hull *hull = s->hull + one->hull;
    one->vertex = own(s, r, 3 * (size_t)hull->vertices, sizeof(double));
    one->normal = own(s, r, 3 * (size_t)hull->faces, sizeof(double));
    one->height = own(s, r, (size_t)hull->faces, sizeof(double));
    one->way = own(s, r, 3 * (size_t)hull->edges, sizeof(double));
  }
  for (int k = 0; k < s->hull_pairs && !r->failed; k++) {
    tl_hull_pair *one = s->hull_pair + k;
    one->pair = next_index(r, 0, s->pairs);
    one->first = next_index(r, 0, s->solids), one->second = next_index(r, 0, s->solids);
  }
}

/* Joints' points, and the laws of pairs and of these. */
static void read_laws(tl_scene *s, reader *r) {
  double **const laws[6] = {&s->friction, &s->fixed, &s->restitution, &s->threshold, &s->thickness, &s->pressing};
  for (int k = 0; k < s->joint_points && !r->failed; k++) {
    tl_joint_point *one = s->joint_point + k;
    one->is_stop = next_index(r, 0, 2), one->entry = next_index(r, 0, s->nq), one->dof = next_index(r, 0, s->nv);
    one->position = next_number(r), one->side = next_number(r);
  }
  for (int k = 0; k < 6; k++) *laws[k] = own_numbers(s, r, s->pairs + s->joint_points);
}

TL_API void tl_contact_free(tl_scene *s) {
  if (!s) return;
  for (void **one = s->owned; one;) {
    void **next = one[0];
    free(one);
    one = next;
  }
  tl_arena *const arenas[5] = {&s->work, s->ends, s->ends + 1, &s->words, &s->blow_words};
  for (int k = 0; k < 5; k++) free(arenas[k]->memory);
  free(s->points);
  tl_free_aligned(s->registers);
  tl_free_aligned(s->loop_registers);
  free(s);
}

/* What loops work with. Which bodies they connect is not known: all are in one tree. */
static void own_loops(tl_scene *s, reader *r) {
  const size_t m = (size_t)s->loops, nv = (size_t)s->nv;
  s->loop_closing = own(s, r, nv, sizeof(double));
  if (!m) return;
  double **const numbers[4] = {&s->loop_open, &s->loop_wanted, &s->loop_missed, &s->loop_parts};
  for (int k = 0; k < 4; k++) *numbers[k] = own(s, r, m, sizeof(double));
  s->loop_gaps = own(s, r, m + m * nv, sizeof(double));
  s->loop_basis = own(s, r, m * nv, sizeof(double));
  s->loop_factor = own(s, r, m * m, sizeof(double));
  s->loop_change = own(s, r, nv, sizeof(double));
  s->loop_order = own(s, r, m, sizeof(int32_t));
  if (!r->failed && !(s->loop_registers = tl_registers(s->loop_program, 1))) r->failed = 2;
  if (!r->failed) s->loop_rows = s->loop_gaps + m;
  for (int b = 1; b < s->bodies; b++) s->body[b].tree = 1;
}

/* Memory for the parts whose numbers the sizes say. */
static void own_parts(tl_scene *s, reader *r) {
  const size_t nv = (size_t)s->nv;
  tl_arena *const arenas[5] = {&s->work, s->ends, s->ends + 1, &s->words, &s->blow_words};
  s->body = own(s, r, (size_t)s->bodies, sizeof(tl_body));
  s->dof_parent = own(s, r, nv, sizeof(int32_t));
  s->dof_body = own(s, r, nv, sizeof(int32_t));
  s->dof_depth = own(s, r, nv, sizeof(int32_t));
  s->factor_at = own(s, r, nv, sizeof(size_t));
  s->on_plane = own(s, r, (size_t)s->on_planes, sizeof(tl_on_plane));
  s->rim = own(s, r, (size_t)s->rims, sizeof(tl_rim));
  s->field = own(s, r, (size_t)s->fields, sizeof(tl_field));
  s->on_field = own(s, r, (size_t)s->on_fields, sizeof(tl_on_field));
  s->round = own(s, r, (size_t)s->rounds, sizeof(tl_round));
  s->round_ends = own(s, r, 2 * (size_t)s->rounds, sizeof(int32_t));
  s->hull = own(s, r, (size_t)s->hulls, sizeof(tl_hull));
  s->solid = own(s, r, (size_t)s->solids, sizeof(tl_solid));
  s->hull_pair = own(s, r, (size_t)s->hull_pairs, sizeof(tl_hull_pair));
  s->joint_point = own(s, r, (size_t)s->joint_points, sizeof(tl_joint_point));
  for (int k = 0; k < 5; k++) {
    arenas[k]->size = k ? SMALL : LARGE; /* what is not used is not there */
    if (!(arenas[k]->memory = malloc(arenas[k]->size))) r->failed = 2;
  }
}

/* A scene from whole numbers and numbers in the order of this file. sizes: bodies with the ground, nq, nv, numbers, pairs,
balls, planes with bodies over them, rims, fields, bodies over fields, rounds, hulls, solids, pairs of hulls, points of joints,
rows of loops. program: of (t, q, v, numbers) for tau - h, or NULL; loops: of q for gaps and rows of loops, or NULL; find: finds other points, or NULL. They must
outlive the scene. misses: as of it. Returns a code; the scene is written to `made`. */
TL_API int tl_contact_new(const int32_t *sizes, int64_t wholes, const int32_t *whole, int64_t numbers, const double *number,
                          const tl_program *program, const tl_program *loops, int level, tl_finder find, int misses,
                          tl_scene **made) {
  if (!made) return TL_BAD_ARGUMENT;
  *made = NULL;
  if (!sizes || wholes < 0 || numbers < 0 || (wholes && !whole) || (numbers && !number) || level < 0 || level > tl_level())
    return TL_BAD_ARGUMENT;
  for (int k = 0; k < SIZES; k++)
    if (sizes[k] < 0 || sizes[k] > MOST || sizes[k] > wholes + numbers) return TL_BAD_ARGUMENT;
  tl_scene *s = calloc(1, sizeof *s);
  if (!s) return TL_NO_MEMORY;
  int *const own_sizes[SIZES] = {&s->bodies, &s->nq, &s->nv, &s->numbers, &s->pairs, &s->balls, &s->on_planes, &s->rims,
                              &s->fields, &s->on_fields, &s->rounds, &s->hulls, &s->solids, &s->hull_pairs,
                              &s->joint_points, &s->loops};
  for (int k = 0; k < SIZES; k++) *own_sizes[k] = sizes[k];
  reader r = {whole, number, wholes, numbers, s->bodies < 1};
  s->program = program, s->loop_program = loops, s->level = level, s->ended = s->ends;
  s->find = find, s->misses = misses != 0;
  if (program && (program->inputs != 1 + s->nq + s->nv + s->numbers || program->outputs != s->nv)) r.failed = 1;
  if (!loops != !s->loops || s->loops > s->nv) r.failed = 1;
  if (loops && (loops->inputs != s->nq || loops->outputs != s->loops * (1 + s->nv))) r.failed = 1;
  if (!r.failed) own_parts(s, &r);
  if (!r.failed) read_bodies(s, &r);
  if (!r.failed) own_places(s, &r);
  if (!r.failed) own_loops(s, &r);
  s->armature = own_numbers(s, &r, s->nv);
  s->viscosity = own_numbers(s, &r, s->nv);
  if (!r.failed) read_planes(s, &r);
  if (!r.failed) read_fields(s, &r);
  if (!r.failed) read_rounds(s, &r);
  if (!r.failed) read_hulls(s, &r);
  if (!r.failed) read_laws(s, &r);
  if (!r.failed && program && !(s->registers = tl_registers(program, 1))) r.failed = 2;
  if (r.failed || r.wholes || r.numbers) {
    tl_contact_free(s);
    return r.failed == 2 ? TL_NO_MEMORY : TL_BAD_ARGUMENT;
  }
  *made = s;
  return TL_FINE;
}
