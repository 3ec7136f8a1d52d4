/* One step in time of bodies that touch, or two halves where its laws are not reached. The statement, with its formulas and
sources, is contact/stepping.py. */
#include "step.h"
#include "vectors.h"

#include <stdlib.h>

#define DEEPEST 0.25 /* of half the bodies' thickness: a step that brings bodies deeper into each other is taken as two */
#define APART 1e-6   /* of a step in which two points of a pair bounce one after the other: it is taken as two */
#define FIRST_PART 0.45 /* of a step that is taken as two, see contact/stepping.py */
#define UNSEEN 0.01  /* of the reach of a step: one after which hulls overlap by so much more is halved */
enum { UNSEEN_HALVINGS = 6, APART_HALVINGS = 20 };

int tl_is_finite(const double *x, int n) {
  for (int i = 0; i < n; i++)
    if (!isfinite(x[i])) return 0;
  return 1;
}

/* The gap below which points count in a step, m: more than bodies move. */
double tl_reach(double h, double fastest) { return 3.0 * h * fastest + 100.0 * h * h; }

/* The end of a step in which nothing touches. */
static int untouched(tl_scene *s, const tl_task *task, const double *middle, const double *free, tl_ended *out) {
  const size_t nv = (size_t)s->nv;
  double *move = tl_take(&s->work, nv, sizeof(double));
  *out = (tl_ended){.h = task->h};
  out->q = tl_take(s->ended, (size_t)s->nq, sizeof(double));
  out->v = tl_take(s->ended, nv, sizeof(double));
  out->mean = tl_take(s->ended, nv, sizeof(double));
  const int code = tl_new_memory(s, 0, &out->memory);
  if (code || !move || !out->q || !out->v || !out->mean) return TL_NO_MEMORY;
  memcpy(out->v, free, nv * sizeof(double));
  for (size_t d = 0; d < nv; d++) move[d] = 0.5 * task->h * free[d] + s->loop_closing[d], out->mean[d] = (free[d] - task->v[d]) / task->h;
  tl_moved(s, middle, move, out->q);
  tl_pass_change(s, task->memory, out->mean, task->memory->count == 0, &out->memory);
  out->memory.unfollowed = task->memory->unfollowed;
  return TL_FINE;
}

/* The mean w' of a step with an impact but for contacts, see `ContactStepper._mean_behind`. a: the one before the impact. */
static int mean_behind(tl_scene *s, const tl_task *task, const double *middle, const double *a, const tl_ended *end,
                       double *out) {
  const size_t nv = (size_t)s->nv;
  const double h = task->h, late = end->blows->late;
  double *turned = tl_take(&s->work, nv, sizeof(double)), *ahead = tl_take(&s->work, nv, sizeof(double));
  if (!turned || !ahead) return TL_NO_MEMORY;
  for (size_t d = 0; d < nv; d++) ahead[d] = end->v[d] - task->v[d];
  tl_free_acceleration(s, task->t + 0.5 * h, middle, end->v, h, ahead, task->numbers, out);
  tl_turning_forces(s, task->v, end->blows->on_joints, turned);
  tl_inward(s, turned);
  tl_outward(s, turned);
  for (size_t d = 0; d < nv; d++) out[d] = (late * a[d] + (h - late) * out[d]) / h + (0.5 - late / h) * turned[d];
  return TL_FINE;
}

/* A step with points, from its middle; free: v+ without impulses, changed where an impact comes in between. */
static int with_contacts(tl_scene *s, const tl_task *task, const double *middle, double *free, tl_ended *out) {
  const size_t nv = (size_t)s->nv;
  tl_row *rows = tl_take(&s->work, (size_t)s->count, sizeof(tl_row));
  double *a = tl_take(&s->work, 2 * nv, sizeof(double));
  tl_law law;
  if (!rows || !a) return TL_NO_MEMORY;
  for (int k = 0; k < s->count; k++) {
    rows[k].y = NULL;
    tl_axes_of(s->points[k].normal, rows[k].axes);
  }
  int code = tl_new_law(s, task->h, task->v, free, rows, task->memory, NULL, &law);
  if (!code) code = tl_end_of_step(s, task, &law, free, middle, out);
  if (code || !out->blows) return code;
  for (size_t d = 0; d < nv; d++) a[d] = (free[d] - task->v[d]) / task->h;
  code = mean_behind(s, task, middle, a, out, a + nv);
  if (code) return code;
  for (size_t d = 0; d < nv; d++) free[d] = task->v[d] + task->h * a[nv + d];
  if (!tl_is_finite(free, s->nv)) return TL_NOT_FINITE;
  tl_keep_loops(s, free);
  tl_ended again;
  const tl_law last = law;
  code = tl_new_law(s, task->h, task->v, free, rows, task->memory, &last, &law);
  if (!code) code = tl_end_of_step(s, task, &law, free, middle, &again);
  if (!code) *out = again;
  return code == TL_HALVE ? TL_FINE : code;
}

/* One step; TL_HALVE where its laws are not reached. */
int tl_step(tl_scene *s, const tl_task *task, tl_ended *out) {
  const double h = task->h;
  const size_t nv = (size_t)s->nv;
  s->work.used = 0;
  double *middle = tl_take(&s->work, (size_t)s->nq, sizeof(double)), *x = tl_take(&s->work, 4 * nv, sizeof(double));
  if (!middle || !x) return TL_NO_MEMORY;
  double *half = x, *change = x + nv, *ahead = x + 2 * nv, *free = x + 3 * nv;
  for (size_t d = 0; d < nv; d++) {
    half[d] = 0.5 * h * task->v[d];
    change[d] = 0.5 * h * (0.5 * (task->memory->change[d] + task->memory->change[nv + d]));
    ahead[d] = task->v[d] + change[d];
  }
  tl_moved(s, task->q, half, middle);
  tl_loops_begin(s, task->q, task->v);
  tl_place(s, middle);
  const double reach = tl_reach(h, tl_fastest(s, task->v));
  tl_factor(s, h);
  tl_free_acceleration(s, task->t + 0.5 * h, middle, ahead, h, change, task->numbers, free);
  for (size_t d = 0; d < nv; d++) free[d] = task->v[d] + h * free[d];
  if (!tl_is_finite(free, s->nv)) return TL_NOT_FINITE;
  tl_loops_at(s, middle, task->v);
  tl_keep_loops(s, free);
  tl_detect(s, reach);
  tl_joint_gaps(s, middle);
  if (s->short_of_memory || s->buried) return TL_NO_STEP;
  if (!s->count) return untouched(s, task, middle, free, out);
  for (int k = 0; k < s->count; k++)
    if (-s->points[k].gap > DEEPEST * s->thickness[s->points[k].pair]) return TL_HALVE;
  return with_contacts(s, task, middle, free, out);
}

/* What hulls overlap at the end of a step; TL_HALVE where it is to be halved for a contact that it has missed: a corner that
comes in from beside a face is no point of the contact problem until it is over the face. */
static int checked(tl_scene *s, const tl_task *task, int halve, tl_ended *out) {
  if (!tl_is_finite(out->v, s->nv)) return TL_NOT_FINITE;
  if (!s->misses) return TL_FINE;
  tl_place(s, out->q);
  const double reach = tl_reach(out->h, tl_fastest(s, out->v)), overlap = tl_overlap(s, NULL);
  if (s->buried) return TL_NO_STEP;
  if (halve && overlap - task->memory->overlap > UNSEEN * reach) return TL_HALVE;
  out->memory.overlap = overlap;
  return TL_FINE;
}

/* Count a step. */
static void count_step(tl_record *record, const tl_ended *end) {
  record->steps += 1;
  record->softened += end->softened;
  if (!end->touches) return;
  *(end->solver == TL_PROXIMAL ? &record->proximal : &record->newton) += 1;
  record->feasibility = tl_larger(record->feasibility, end->feasibility);
  record->complementarity = tl_larger(record->complementarity, end->complementarity);
}

/* A point of one of two halves. */
typedef struct {
  int64_t key;
  int half, number;
} of_half;

static int by_key(const void *a, const void *b) {
  const of_half *x = a, *y = b;
  if (x->key != y->key) return x->key < y->key ? -1 : 1;
  return x->half - y->half;
}

/* The points of two halves as those of one step: impulses are added, places and slips are the later ones. */
static int join_points(tl_scene *s, const tl_ended *const halves[2], tl_ended *out) {
  const size_t most = (size_t)halves[0]->count + (size_t)halves[1]->count;
  of_half *order = tl_take(&s->work, most, sizeof(of_half));
  double *x = tl_take(s->ended, 9 * most, sizeof(double));
  int64_t *keys = tl_take(s->ended, most, sizeof(int64_t));
  if (!order || !x || !keys) return TL_NO_MEMORY;
  size_t size = 0;
  for (int half = 0; half < 2; half++)
    for (int i = 0; i < halves[half]->count; i++) order[size++] = (of_half){halves[half]->keys[i], half, i};
  qsort(order, size, sizeof(of_half), by_key);
  out->keys = keys, out->places = x, out->on_first = x + 3 * most, out->slips = x + 6 * most, out->count = 0;
  for (size_t k = 0; k < size; k++) {
    const tl_ended *half = halves[order[k].half];
    const int from = 3 * order[k].number, is_new = !k || order[k].key != order[k - 1].key;
    if (is_new) keys[out->count++] = order[k].key;
    const int at = 3 * (out->count - 1);
    if (is_new) memset(out->on_first + at, 0, 3 * sizeof(double));
    tl_copy3(half->places + from, out->places + at);
    tl_copy3(half->slips + from, out->slips + at);
    tl_add_scaled(1, half->on_first + from, out->on_first + at);
  }
  return TL_FINE;
}

/* Two halves as one step, see `Step.with_next`. */
static int join(tl_scene *s, const tl_ended *first, const tl_ended *second, tl_ended *out) {
  const tl_ended *const halves[2] = {first, second};
  *out = *second;
  out->h = first->h + second->h;
  for (int d = 0; d < s->nv; d++) {
    out->mean[d] = (first->h * first->mean[d] + second->h * second->mean[d]) / out->h;
    if (first->joints && second->joints) out->joints[d] += first->joints[d];
  }
  if (!out->joints) out->joints = first->joints;
  for (tl_blow *one = second->blows; one; one = one->next) one->late += first->h;
  if (first->blows) {
    first->last_blow->next = second->blows;
    out->blows = first->blows;
    if (!second->blows) out->last_blow = first->last_blow;
  }
  s->work.used = 0;
  return join_points(s, halves, out);
}

/* One step, or two, see `ContactStepper.advance`; TL_NO_STEP where these are too small. */
int tl_advance(tl_scene *s, const tl_task *task, int depth, int bounces, tl_ended *out) {
  int code = tl_step(s, task, out);
  const int apart = !code && bounces < APART_HALVINGS && out->apart > APART;
  if (!code && !apart) code = checked(s, task, depth < UNSEEN_HALVINGS, out);
  if (!code && !apart) count_step(&s->record, out);
  if (code != TL_HALVE && !apart) return code;
  if (!apart && depth == TL_HALVINGS) return TL_NO_STEP;
  s->record.halved += 1;
  depth += !apart, bounces += apart;
  tl_ended first, second;
  tl_task part = *task;
  part.h = FIRST_PART * task->h;
  code = tl_advance(s, &part, depth, bounces, &first);
  if (code) return code;
  part.t = task->t + part.h, part.h = task->h - part.h;
  part.q = first.q, part.v = first.v, part.memory = &first.memory;
  code = tl_advance(s, &part, depth, bounces, &second);
  return code ? code : join(s, &first, &second, out);
}
