/* Many steps in one call, and what is told of those at whose end a sample is, of the last, and of impacts.

What is told is a row of words of 8 bytes each, numbers or whole ones, see native/contact.py. */
#include "step.h"
#include "vectors.h"

#include <stdlib.h>

#define MOST_MEMORY ((size_t)1 << 33) /* bytes of an arena */

/* The steps to take: begins, lengths, pieces and whether samples are at the ends (count). numbers (pieces, numbers). find: finds
other points, or NULL. misses: as of the scene. */
typedef struct {
  const double *t, *h;
  const int64_t *piece;
  const uint8_t *sampled;
  const double *numbers;
  int64_t count, pieces;
  tl_finder find;
  int64_t misses;
} tl_plan;

/* Where a run begins: the state, and its memory, whose keys rise. */
typedef struct {
  const double *q, *v, *forces, *change;
  const int64_t *keys;
  const uint8_t *stuck, *still;
  int64_t count;
  double overlap, unfollowed;
} tl_start;

/* What a run gives: words of steps that are told of, and of impacts; the record; whether bodies rest at the end. */
typedef struct {
  const void *words, *blow_words;
  int64_t word_count, blow_count, rests;
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

/* Tell of the end of the step `number`. */
static int tell(tl_scene *s, const tl_ended *end, int64_t number) {
  const tl_memory *m = &end->memory;
  tl_arena *to = &s->words;
  tl_place(s, end->q);
  double overlap = tl_overlap(s, end->q);
  if (s->buried || s->short_of_memory) overlap = NAN;
  const int64_t head[8] = {number, end->touches, end->solver, end->softened, end->rests, m->count, end->count,
                           end->joints != NULL};
  const double numbers[7] = {end->h, overlap, end->feasibility, end->complementarity, end->residual, m->overlap,
                             m->unfollowed};
  int code = tell_wholes(to, head, 8);
  if (!code) code = tell_numbers(to, numbers, 7);
  if (!code) code = tell_numbers(to, end->q, s->nq);
  if (!code) code = tell_numbers(to, end->v, s->nv);
  if (!code) code = tell_numbers(to, end->mean, s->nv);
  if (!code) code = tell_numbers(to, m->change, 2 * s->nv);
  if (!code) code = tell_wholes(to, m->keys, m->count);
  if (!code) code = tell_numbers(to, m->forces, 3 * m->count);
  if (!code) code = tell_marks(to, m->stuck, m->count);
  if (!code) code = tell_marks(to, m->still, m->count);
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
    const int code = tl_advance(s, task, 0, out);
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
  const size_t bytes = (size_t)s->nv * sizeof(double);
  memcpy(out->q, task->q, (size_t)s->nq * sizeof(double));
  memset(out->v, 0, bytes);
  memset(out->mean, 0, bytes);
  memset(out->memory.change, 0, 2 * bytes);
  return 1;
}

static int is_sound(const tl_scene *s, const tl_plan *plan, const tl_start *start) {
  if (!plan->t || !plan->h || !plan->piece || !plan->sampled || plan->count < 0 || plan->count > TL_MAX_COUNT ||
      (s->numbers && !plan->numbers) || plan->pieces < 1 || !start->q || !start->v || !start->change || start->count < 0 ||
      start->count > (1 << 24))
    return 0;
  if (start->count && !(start->forces && start->keys && start->stuck && start->still)) return 0;
  for (int64_t k = 0; k < plan->count; k++)
    if (plan->piece[k] < 0 || plan->piece[k] >= plan->pieces) return 0;
  for (int64_t k = 1; k < start->count; k++)
    if (start->keys[k] <= start->keys[k - 1]) return 0;
  return 1;
}

/* Steps of a plan, up to its end, to bodies at rest, or to a step that is not found: how many were taken, or a code below 0.
What is told stays until the next run. One thread at a time may call it. */
TL_API int64_t tl_contact_run(tl_scene *s, const tl_plan *plan, const tl_start *start, tl_told *told) {
  if (!s || !plan || !start || !told || !is_sound(s, plan, start)) return -TL_BAD_ARGUMENT;
  tl_memory memory = {(int)start->count, (int64_t *)start->keys, (double *)start->forces, (double *)start->change,
                      start->overlap, start->unfollowed, (uint8_t *)start->stuck, (uint8_t *)start->still};
  tl_task task = {.q = start->q, .v = start->v, .memory = &memory};
  tl_ended end, last;
  int64_t taken = 0, rests = 0, is_told = 0;
  memset(&s->record, 0, sizeof s->record);
  s->words.used = s->blow_words.used = 0, s->short_of_memory = 0;
  s->find = plan->find, s->misses = plan->misses != 0;
  while (taken < plan->count && !rests) {
    task.t = plan->t[taken], task.h = plan->h[taken];
    task.numbers = s->numbers ? plan->numbers + plan->piece[taken] * s->numbers : NULL;
    s->ended = s->ends + taken % 2;
    if (!(task.h > 0.0) || step_whole(s, &task, &end)) break;
    rests = comes_to_rest(s, &task, &end);
    end.rests = (int)rests;
    is_told = plan->sampled[taken];
    if ((is_told && tell(s, &end, taken)) || tell_blows(s, &end, task.t - plan->t[0])) return -TL_NO_MEMORY;
    last = end;
    task.q = last.q, task.v = last.v, task.memory = &last.memory;
    taken++;
  }
  if (taken && !is_told && tell(s, &last, taken - 1)) return -TL_NO_MEMORY;
  *told = (tl_told){s->words.memory, s->blow_words.memory, (int64_t)(s->words.used / sizeof(double)),
                    (int64_t)(s->blow_words.used / sizeof(double)), rests, s->record};
  return taken;
}
