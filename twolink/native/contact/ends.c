/* The end of a step with contacts: where the impulses lead, what they leave to the next step, and what is told of them. The
statement is `ContactStepper._with_contacts`. */
#include "step.h"
#include "vectors.h"

#include <stdlib.h>

#define FELT 1e-6     /* of the largest impulse of an impact: what is passed on */
#define FARTHEST 0.5  /* of half the bodies' thickness: one half of a step in which they move farther could pass through */
#define PIVOT 1e-9    /* of the largest: smaller pivots of Y Y^T are those of motions that the rows leave free */

/* What a step's end is made of. at (n): of each point its place in the solution, -1 where it is not active. move, push (nv).
u, off (n, 3): velocities at the end; slips, and gaps before the push. */
typedef struct {
  tl_scene *s;
  const tl_task *task;
  tl_law *law;
  tl_solution found;
  int32_t *at;
  double *move, *push, *u, *off;
  uint8_t *lasts;
} ending;

static int take(ending *e) {
  const size_t n = (size_t)e->law->n, nv = (size_t)e->s->nv;
  e->at = tl_take(&e->s->work, n, sizeof(int32_t));
  e->move = tl_take(&e->s->work, nv, sizeof(double));
  e->push = tl_take(&e->s->work, nv, sizeof(double));
  e->u = tl_take(&e->s->work, 3 * n, sizeof(double));
  e->off = tl_take(&e->s->work, 3 * n, sizeof(double));
  e->lasts = tl_take(&e->s->work, 3 * n, 1);
  return e->at && e->move && e->push && e->u && e->off && e->lasts ? TL_FINE : TL_NO_MEMORY;
}

static int presses(const ending *e, int k) { return e->at[k] >= 0 && e->found.p[3 * e->at[k] + 2] > 0.0; }

/* What impulses of impacts move within the step, as they act before its middle; nothing where a contact that lasts passes the
impact on, and would act at another time than it. */
static void shift(ending *e, double *out) {
  const tl_law *law = e->law;
  double u[3];
  memset(out, 0, (size_t)e->s->nv * sizeof(double));
  for (int k = 0; k < law->n; k++) {
    if (e->at[k] < 0 || law->late[k] == 0.0) continue;
    const double *p = e->found.p + 3 * e->at[k];
    const double share[3] = {law->late[k] * p[0], law->late[k] * p[1], law->late[k] * p[2]};
    tl_add_row(law->rows + k, law->rows[k].y, share, out);
  }
  tl_outward(e->s, out);
  for (int k = 0; k < law->n; k++) {
    if (!presses(e, k) || !law->known[k]) continue;
    tl_row_times(law->rows + k, out, u);
    if (!(fabs(u[2]) <= TL_CLOSED)) {
      memset(out, 0, (size_t)e->s->nv * sizeof(double));
      return;
    }
  }
}

/* The motion from the middle to the end of the step. */
static int positions(ending *e) {
  const tl_law *law = e->law;
  const double half = 0.5 * law->h;
  shift(e, e->move);
  for (int d = 0; d < e->s->nv; d++) e->move[d] += half * e->found.ends[d] + e->s->loop_closing[d];
  tl_speeds(e->s, law->points, law->rows, law->n, e->found.ends, e->u);
  tl_speeds(e->s, law->points, law->rows, law->n, e->move, law->moves);
  for (int k = 0; k < law->n; k++) {
    double *u = e->u + 3 * k, *off = e->off + 3 * k;
    uint8_t *lasts = e->lasts + 3 * k;
    for (int m = 0; m < 2; m++) off[m] = half * (law->before[3 * k + m] + u[m]);
    off[2] = law->points[k].gap + law->moves[3 * k + 2];
    lasts[0] = lasts[1] = 0;
    lasts[2] = presses(e, k) && law->known[k] && law->rests[k];
    if (!lasts[2] || !law->stuck[k] || law->of_joints[k]) continue;
    const double *slip = e->found.u + 3 * e->at[k];
    lasts[0] = lasts[1] = sqrt(slip[0] * slip[0] + slip[1] * slip[1]) < TL_STILL;
  }
  const int code = tl_correction(e->s, law, e->off, e->lasts, e->push);
  for (int d = 0; d < e->s->nv; d++) e->move[d] += e->push[d];
  return code;
}

/* Room for what so many contacts remember. */
int tl_new_memory(tl_scene *s, int count, tl_memory *out) {
  const size_t n = (size_t)count;
  out->count = count, out->overlap = out->unfollowed = 0.0;
  out->keys = tl_take(s->ended, n, sizeof(int64_t));
  out->forces = tl_take(s->ended, 3 * n, sizeof(double));
  out->stuck = tl_take(s->ended, n, 1);
  out->still = tl_take(s->ended, n, 1);
  out->change = tl_take(s->ended, 2 * (size_t)s->nv, sizeof(double));
  return out->keys && out->forces && out->stuck && out->still && out->change ? TL_FINE : TL_NO_MEMORY;
}

/* The changes w' of the last two steps for the next one; 0 where the step was not smooth. */
void tl_pass_change(const tl_scene *s, const tl_memory *memory, const double *mean, int smooth, tl_memory *out) {
  int any = 0;
  for (int d = 0; d < s->nv; d++) any |= memory->change[d] != 0.0;
  for (int d = 0; d < s->nv; d++) {
    out->change[d] = smooth ? mean[d] : 0.0;
    out->change[s->nv + d] = smooth ? (any ? memory->change[d] : mean[d]) : 0.0;
  }
}

/* A point that stays closed: its key and number. */
typedef struct {
  int64_t key;
  int number;
} kept_point;

static int by_key(const void *a, const void *b) {
  const kept_point *x = a, *y = b;
  return x->key < y->key ? -1 : x->key > y->key;
}

/* What presses or stays closed. */
static int remember(ending *e, tl_ended *out) {
  const tl_law *law = e->law;
  const tl_memory *before = e->task->memory;
  kept_point *kept = tl_take(&e->s->work, (size_t)law->n, sizeof(kept_point));
  int count = 0, hit = 0;
  if (!kept) return TL_NO_MEMORY;
  for (int k = 0; k < law->n; k++) {
    double moves[3];
    if (e->at[k] < 0) continue;
    tl_row_times(law->rows + k, e->push, moves);
    const int closed = fabs(e->u[3 * k + 2]) < TL_STILL && fabs(e->off[3 * k + 2] + moves[2]) < TL_CLOSED;
    if (!presses(e, k) && !closed) continue;
    kept[count++] = (kept_point){law->points[k].key, k};
    hit |= law->hits[k];
  }
  qsort(kept, (size_t)count, sizeof(kept_point), by_key);
  tl_memory *memory = &out->memory;
  const int code = tl_new_memory(e->s, count, memory);
  if (code) return code;
  int same = count == before->count;
  for (int i = 0; i < count; i++) {
    const int k = kept[i].number;
    const double *p = e->found.p + 3 * e->at[k], *slip = e->found.u + 3 * e->at[k];
    memory->keys[i] = kept[i].key;
    same = same && before->keys[i] == kept[i].key;
    for (int m = 0; m < 3; m++) memory->forces[3 * i + m] = p[m] / law->h;
    memory->stuck[i] = sqrt(slip[0] * slip[0] + slip[1] * slip[1]) < TL_STILL;
    memory->still[i] = fabs(e->u[3 * k + 2]) < TL_STILL;
  }
  tl_pass_change(e->s, before, out->mean, same && !hit, memory);
  memory->unfollowed = before->unfollowed;
  return tl_unfollowed(e->s, law, &e->found, &memory->unfollowed);
}

/* A vector from its parts along the first axes. */
static void along(const double *parts, const double *axes, int count, double *out) {
  memset(out, 0, 3 * sizeof(double));
  for (int k = 0; k < count; k++) tl_add_scaled(parts[k], axes + 3 * k, out);
}

/* Impulses of impacts, with those that other points pass on. */
static int blow(ending *e, tl_ended *out) {
  const tl_law *law = e->law;
  double most = 0.0;
  int first = -1, count = 0;
  out->blows = out->last_blow = NULL;
  for (int k = 0; k < law->n; k++) {
    double p[3];
    if (!presses(e, k) || !law->hits[k]) continue;
    tl_minus(e->found.p + 3 * e->at[k], law->lasting + 3 * k, p);
    if (first < 0 || tl_length(p) > most) most = tl_length(p), first = k;
  }
  if (first < 0) return TL_FINE;
  tl_blow *one = tl_take(e->s->ended, 1, sizeof(tl_blow));
  int64_t *keys = tl_take(e->s->ended, (size_t)law->n, sizeof(int64_t));
  double *on_first = tl_take(e->s->ended, 3 * (size_t)law->n, sizeof(double));
  double *on_joints = tl_take(e->s->ended, (size_t)e->s->nv, sizeof(double));
  if (!one || !keys || !on_first || !on_joints) return TL_NO_MEMORY;
  memset(on_joints, 0, (size_t)e->s->nv * sizeof(double));
  for (int k = 0; k < law->n; k++) {
    double p[3];
    if (!presses(e, k) || law->of_joints[k]) continue;
    tl_minus(e->found.p + 3 * e->at[k], law->lasting + 3 * k, p);
    if (!(tl_length(p) > FELT * most)) continue;
    keys[count] = law->points[k].key;
    along(p, law->rows[k].axes, 3, on_first + 3 * count++);
    tl_add_row(law->rows + k, law->rows[k].j, p, on_joints);
  }
  *one = (tl_blow){NULL, 0.5 * law->h - law->late[first], on_first, on_joints, count, keys};
  out->blows = out->last_blow = one;
  return TL_FINE;
}

/* The longest time between bounces of one pair, whose points follow each other, of the step. */
static double apart(const ending *e) {
  const tl_law *law = e->law;
  double first = 0.0, last = 0.0, most = 0.0;
  for (int k = 0, pair = -1; k < law->n; k++) {
    if (!presses(e, k) || !law->bounces[k]) continue;
    if (law->points[k].pair != pair) pair = law->points[k].pair, first = last = law->late[k];
    first = tl_larger(first, law->late[k]), last = -tl_larger(-last, -law->late[k]);
    most = tl_larger(most, first - last);
  }
  return most / law->h;
}

/* Impulses on bodies at points that press, and on joints. */
static int tell(ending *e, tl_ended *out) {
  const tl_law *law = e->law;
  const size_t n = (size_t)law->n;
  double *x = tl_take(e->s->ended, 9 * n, sizeof(double));
  out->keys = tl_take(e->s->ended, n, sizeof(int64_t));
  out->joints = e->s->joint_points ? tl_take(e->s->ended, (size_t)e->s->nv, sizeof(double)) : NULL;
  if (!x || !out->keys || (e->s->joint_points && !out->joints)) return TL_NO_MEMORY;
  out->places = x, out->on_first = x + 3 * n, out->slips = x + 6 * n, out->count = 0;
  if (out->joints) memset(out->joints, 0, (size_t)e->s->nv * sizeof(double));
  for (int k = 0; k < law->n; k++) {
    if (!presses(e, k)) continue;
    const double *p = e->found.p + 3 * e->at[k];
    if (law->of_joints[k]) {
      tl_add_row(law->rows + k, law->rows[k].j, p, out->joints);
      continue;
    }
    const int i = out->count++;
    out->keys[i] = law->points[k].key;
    tl_copy3(law->points[k].position, out->places + 3 * i);
    along(p, law->rows[k].axes, 3, out->on_first + 3 * i);
    along(e->u + 3 * k, law->rows[k].axes, 2, out->slips + 3 * i);
  }
  return TL_FINE;
}

static double largest(const double *x, int n) {
  double most = 0.0;
  for (int i = 0; i < n; i++)
    if (!(fabs(x[i]) <= most)) most = fabs(x[i]);
  return most;
}

/* Whether rows hold all bodies: Y^T x = 0 has no other solution than 0, by the pivots of Y Y^T. */
static int hold(tl_scene *s, const tl_row *const *rows, int n) {
  tl_system g;
  if (tl_new_system(s, rows, NULL, n, n, &g)) return 0;
  double most = 0.0;
  int held = 0;
  memset(g.x, 0, TL_LANES * (size_t)g.nodes * sizeof(double));
  for (int m = 0; m < g.first[n]; m++)
    for (int k = 0; k < TL_PART; k++) {
      const double y = g.y[TL_PART * (size_t)m + (size_t)k];
      g.x[TL_LANES * g.node[m] + k % TL_LANES] += y * y;
    }
  for (int k = 0; k < TL_LANES * g.nodes; k++) most = tl_larger(most, g.x[k]);
  memset(g.coupling, 0, 9 * (size_t)n * sizeof(double));
  for (int k = 0; k < 3 * n; k++) g.coupling[3 * k + k % 3] = 1.0;
  for (int i = 0; i < g.nodes; i++, held += g.used[i - 1])
    for (int k = 0; k < TL_NODE; k++) g.mass[TL_LANES * i + k] = k < g.used[i] ? 0.0 : most;
  if (held < s->nv || !tl_factor_system(s->level, &g)) return 0;
  for (int i = 0; i < g.nodes; i++)
    for (int k = 0; k < TL_NODE; k++)
      if (!(fabs(g.own[TL_BLOCK * (size_t)i + (TL_LANES + 1) * (size_t)k]) * PIVOT * most < 1.0)) return 0;
  return 1;
}

/* Whether nothing moves and nothing can, as all contacts stick. See contact/rest.py. */
static int rests(ending *e, const tl_ended *out) {
  const tl_law *law = e->law;
  const int nv = e->s->nv;
  if (!(largest(e->task->v, nv) <= TL_EXACT && largest(out->v, nv) <= TL_EXACT)) return 0;
  for (int i = 0; i < out->memory.count; i++)
    if (!out->memory.stuck[i]) return 0;
  const tl_row **rows = tl_take(&e->s->work, (size_t)law->n, sizeof *rows);
  int count = 0;
  if (!rows) return 0;
  for (int k = 0; k < law->n; k++)
    if (presses(e, k)) rows[count++] = law->rows + k;
  return hold(e->s, rows, count);
}

/* The end of a step of points with rows, which would end with `free` without impulses; TL_HALVE where it is not reached. */
int tl_end_of_step(tl_scene *s, const tl_task *task, tl_law *law, const double *free, const double *middle, tl_ended *out) {
  ending e = {.s = s, .task = task, .law = law};
  for (int k = 0; k < law->n; k++)
    if (0.5 * law->h * tl_length(law->before + 3 * k) > FARTHEST * s->thickness[law->points[k].pair]) return TL_HALVE;
  int code = tl_without_gain(s, law, free, &e.found);
  if (!code) code = take(&e);
  if (code) return code;
  for (int k = 0; k < law->n; k++) e.at[k] = -1;
  for (int i = 0; i < e.found.count; i++) e.at[e.found.active[i]] = i;
  code = positions(&e);
  if (code) return code;
  const size_t nv = (size_t)s->nv;
  *out = (tl_ended){.h = law->h, .touches = 1, .solver = e.found.answer.solver, .softened = law->share < 1.0};
  out->feasibility = e.found.answer.feasibility, out->complementarity = e.found.answer.complementarity;
  out->residual = e.found.answer.residual;
  out->q = tl_take(s->ended, (size_t)s->nq, sizeof(double));
  out->v = tl_take(s->ended, nv, sizeof(double));
  out->mean = tl_take(s->ended, nv, sizeof(double));
  if (!out->q || !out->v || !out->mean) return TL_NO_MEMORY;
  memcpy(out->v, e.found.ends, nv * sizeof(double));
  for (int d = 0; d < s->nv; d++) out->mean[d] = (out->v[d] - task->v[d]) / law->h;
  tl_moved(s, middle, e.move, out->q);
  code = remember(&e, out);
  if (!code) code = blow(&e, out);
  if (!code) code = tell(&e, out);
  out->rests = !code && rests(&e, out), out->apart = apart(&e);
  return code;
}
