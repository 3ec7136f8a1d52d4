/* Many steps in one call, and what is told of those at whose end a sample is, of the last, and of impacts.

What is told is a row of words of 8 bytes each, numbers or whole ones, see native/contact.py. */
#include "step.h"
#include "vectors.h"

#include <stdlib.h>

#define MOST_MEMORY ((size_t)1 << 33) /* bytes of an arena */

/* The steps of a plan as words: of each its begin, its length, its piece and its mark, `total` words each, then numbers
(pieces, numbers). Steps whose mark is not 0 are told of, of odd ones the overlap too. */
typedef struct {
  const double *t, *h, *numbers;
  const int64_t *piece, *mark;
} tl_plan;

/* What a run gives: words of steps that are told of, and of impacts; where those of the last step begin, and the size of
its memory; whether bodies rest at the end; the record. */
typedef struct {
  const void *words, *blow_words;
  int64_t word_count, blow_count, last, known, rests;
  tl_record record;
} tl_told;

static int grow(tl_arena *arena, int keep) {
  size_t size = 4 * arena->size;
  if (size < arena->wanted + arena->wanted / 2) size = arena->wanted + arena->wanted / 2;
  if (size > MOST_MEMORY) return TL_NO_MEMORY;
  char *memory = keep ? realloc(arena->memory, size) : malloc(size);
  if (!memory) return TL_NO_MEMORY;
  if (!keep) free(arena->memory);
  arena->memory = memory, arena->size = size, arena->wanted = 0;
  return TL_FINE;
}

/* Room behind the words that are there. */
static void *more(tl_arena *words, size_t count) {
  void *out = tl_take(words, count, sizeof(double));
  if (!out && !grow(words, 1)) out = tl_take(words, count, sizeof(double));
  return out;
}

/* Append numbers, whole numbers, or marks. */
static int tell_numbers(tl_arena *words, const double *x, int count) {
  double *to = more(words, (size_t)count);
  if (to && count) memcpy(to, x, (size_t)count * sizeof(double));
  if (to && count % 2) words->used -= sizeof(double); /* what arenas round up to */
  return to ? TL_FINE : TL_NO_MEMORY;
}

static int tell_wholes(tl_arena *words, const int64_t *x, int count) {
  int64_t *to = more(words, (size_t)count);
  if (to && count) memcpy(to, x, (size_t)count * sizeof(int64_t));
  if (to && count % 2) words->used -= sizeof(double);
  return to ? TL_FINE : TL_NO_MEMORY;
}

static int tell_marks(tl_arena *words, const uint8_t *x, int count) {
  int code = TL_FINE;
  for (int i = 0; i < count && !code; i++) {
    const int64_t one = x[i];
    code = tell_wholes(words, &one, 1);
  }
  return code;
}

/* Tell of a memory: what `remembered` reads. */
static int tell_memory(const tl_scene *s, tl_arena *to, const tl_memory *m) {
  const int64_t count = m->count;
  const double numbers[2] = {m->overlap, m->unfollowed};
  int code = tell_wholes(to, &count, 1);
  if (!code) code = tell_numbers(to, numbers, 2);
  if (!code) code = tell_numbers(to, m->change, 2 * s->nv);
  if (!code) code = tell_wholes(to, m->keys, m->count);
  if (!code) code = tell_numbers(to, m->forces, 3 * m->count);
  if (!code) code = tell_marks(to, m->stuck, m->count);
  return code ? code : tell_marks(to, m->still, m->count);
}

/* The memory that was told, in the words of the caller; its marks are in the arena of ends that is not used next. */
static int remembered(tl_scene *s, const double *words, int64_t size, tl_memory *out) {
  const int64_t *whole = (const int64_t *)words, own = 3 + 2 * (int64_t)s->nv;
  if (size < own || whole[0] < 0 || whole[0] > (1 << 24) || size != own + 6 * whole[0]) return TL_BAD_ARGUMENT;
  const int count = (int)whole[0];
  const double *number = words + own;
  *out = (tl_memory){count, (int64_t *)(whole + own), (double *)(number + count), (double *)(words + 3), words[1], words[2],
                     NULL, NULL};
  for (int k = 1; k < count; k++)
    if (out->keys[k] <= out->keys[k - 1]) return TL_BAD_ARGUMENT;
  tl_arena *to = s->ends + 1;
  to->used = 0;
  uint8_t *marks = tl_take(to, 2 * (size_t)count, 1);
  if (!marks && !grow(to, 0)) marks = tl_take(to, 2 * (size_t)count, 1);
  if (!marks) return TL_NO_MEMORY;
  for (int k = 0; k < 2 * count; k++) marks[k] = whole[own + 4 * count + k] != 0;
  out->stuck = marks, out->still = marks + count;
  return TL_FINE;
}

/* Tell of the end of the step `number`; of its overlap where samples will ask for it: there, or of bodies at rest. */
static int tell(tl_scene *s, const tl_ended *end, int64_t number, int sampled) {
  const tl_memory *m = &end->memory;
  tl_arena *to = &s->words;
  if (sampled) tl_place(s, end->q);
  double overlap = sampled ? tl_larger(tl_overlap(s, end->q), tl_loop_gap(s, end->q)) : NAN;
  if (s->buried || s->short_of_memory) overlap = NAN;
  const int64_t head[7] = {number, end->touches, end->solver, end->softened, m->count, end->count, end->joints != NULL};
  const double numbers[5] = {end->h, overlap, end->feasibility, end->complementarity, end->residual};
  int code = tell_wholes(to, head, 7);
  if (!code) code = tell_numbers(to, numbers, 5);
  if (!code) code = tell_numbers(to, end->q, s->nq);
  if (!code) code = tell_numbers(to, end->v, s->nv);
  if (!code) code = tell_numbers(to, end->mean, s->nv);
  if (!code) code = tell_memory(s, to, m);
  if (!code) code = tell_wholes(to, end->keys, end->count);
  if (!code) code = tell_numbers(to, end->places, 3 * end->count);
  if (!code) code = tell_numbers(to, end->on_first, 3 * end->count);
  if (!code) code = tell_numbers(to, end->slips, 3 * end->count);
  if (!code && end->joints) code = tell_numbers(to, end->joints, s->nv);
  return code;
}

/* Tell of the impacts in a step that begins so long after the run. */
static int tell_blows(tl_scene *s, const tl_ended *end, double after) {
  int code = TL_FINE;
  for (const tl_blow *one = end->blows; one && !code; one = one->next) {
    const int64_t count = one->count;
    const double late = after + one->late;
    code = tell_wholes(&s->blow_words, &count, 1);
    if (!code) code = tell_numbers(&s->blow_words, &late, 1);
    if (!code) code = tell_wholes(&s->blow_words, one->keys, one->count);
    if (!code) code = tell_numbers(&s->blow_words, one->on_first, 3 * one->count);
    if (!code) code = tell_numbers(&s->blow_words, one->on_joints, s->nv);
  }
  return code;
}

/* One whole step, with as much memory as it needs. */
static int step_whole(tl_scene *s, const tl_task *task, tl_ended *out) {
  const tl_record before = s->record;
  for (;;) {
    s->record = before, s->ended->used = 0, s->work.wanted = s->ended->wanted = 0;
    const int code = tl_advance(s, task, 0, 0, out);
    if (code) s->record = before;
    if (code != TL_NO_MEMORY) return code;
    if (!s->work.wanted && !s->ended->wanted) return code;
    if (s->work.wanted && grow(&s->work, 0)) return code;
    if (s->ended->wanted && grow(s->ended, 0)) return code;
  }
}

/* Whether a step that rests began so too, with the same contacts; its end is then its begin, at rest. */
static int comes_to_rest(const tl_scene *s, const tl_task *task, tl_ended *out) {
  if (!out->rests || out->memory.count != task->memory->count) return 0;
  for (int i = 0; i < out->memory.count; i++)
    if (out->memory.keys[i] != task->memory->keys[i]) return 0;
  for (int d = 0; d < s->nv; d++)
    if (!(fabs(task->v[d]) <= TL_EXACT)) return 0;
  for (int i = 0; i < s->nq; i++) /* gaps that close move what has no velocity */
    if (!(fabs(out->q[i] - task->q[i]) <= TL_CLOSED)) return 0;
  const size_t bytes = (size_t)s->nv * sizeof(double);
  memcpy(out->q, task->q, (size_t)s->nq * sizeof(double));
  memset(out->v, 0, bytes);
  memset(out->mean, 0, bytes);
  memset(out->memory.change, 0, 2 * bytes);
  return 1;
}

/* The arrays of a plan; 0 where its steps from the first on are not sound. */
static int read_plan(const tl_scene *s, const double *words, int64_t total, int64_t pieces, int64_t first, int64_t count,
                     tl_plan *plan) {
  if (!words || total < 0 || total > TL_MAX_COUNT || pieces < 1 || first < 0 || count < 0 || count > total - first) return 0;
  const int64_t *wholes = (const int64_t *)words;
  *plan = (tl_plan){words + first, words + total + first, s->numbers ? words + 4 * total : NULL, wholes + 2 * total + first,
                    wholes + 3 * total + first};
  for (int64_t k = 0; k < count; k++)
    if (plan->piece[k] < 0 || plan->piece[k] >= pieces) return 0;
  return 1;
}

/* Steps of a plan from the first on, up to their count, to bodies at rest, or to a step that is not found: how many were taken,
or a code below 0. start (size): q, v, and the words of a memory as they are told. What is told stays until the next run. One
thread at a time may call it. */
TL_API int64_t tl_contact_run(tl_scene *s, const double *words, int64_t total, int64_t pieces, int64_t first, int64_t count,
                              const double *start, int64_t size, tl_told *told) {
  tl_plan plan;
  tl_memory memory;
  if (!s || !start || !told || !read_plan(s, words, total, pieces, first, count, &plan)) return -TL_BAD_ARGUMENT;
  const int64_t own = (int64_t)s->nq + s->nv;
  if (size < own) return -TL_BAD_ARGUMENT;
  const int code = remembered(s, start + own, size - own, &memory);
  if (code) return -code;
  tl_task task = {.q = start, .v = start + s->nq, .memory = &memory};
  tl_ended end, last;
  int64_t taken = 0, rests = 0, is_told = 0, at = 0;
  memset(&s->record, 0, sizeof s->record);
  s->words.used = s->blow_words.used = 0, s->short_of_memory = 0;
  while (taken < count && !rests) {
    task.t = plan.t[taken], task.h = plan.h[taken];
    task.numbers = s->numbers ? plan.numbers + plan.piece[taken] * s->numbers : NULL;
    s->ended = s->ends + taken % 2;
    if (!(task.h > 0.0) || step_whole(s, &task, &end)) break;
    rests = comes_to_rest(s, &task, &end);
    is_told = plan.mark[taken] != 0;
    if (is_told) at = (int64_t)(s->words.used / sizeof(double));
    if ((is_told && tell(s, &end, taken, rests || plan.mark[taken] & 1)) || tell_blows(s, &end, task.t - plan.t[0]))
      return -TL_NO_MEMORY;
    last = end;
    task.q = last.q, task.v = last.v, task.memory = &last.memory;
    taken++;
  }
  if (taken && !is_told) {
    at = (int64_t)(s->words.used / sizeof(double));
    if (tell(s, &last, taken - 1, rests != 0)) return -TL_NO_MEMORY;
  }
  *told = (tl_told){s->words.memory, s->blow_words.memory, (int64_t)(s->words.used / sizeof(double)),
                    (int64_t)(s->blow_words.used / sizeof(double)), at, taken ? last.memory.count : 0, rests, s->record};
  return taken;
}
