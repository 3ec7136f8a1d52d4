/* The laws of the points of a step: what touches, when in the step it meets, and by how much it bounces. Statement and sources:
contact/step_law.py, whose names the fields have. */
#include "step.h"
#include "vectors.h"

/* Memory for the laws of n points. */
static int take(tl_scene *s, tl_law *law, int n) {
  double **const vectors[6] = {&law->before, &law->after, &law->guess, &law->lasting, &law->sums, &law->moves};
  double **const numbers[8] = {&law->rebound, &law->open, &law->late, &law->heights,
                               &law->given, &law->mu, &law->slower, &law->ends};
  uint8_t **const marks[8] = {&law->known, &law->stuck, &law->hits, &law->bounces,
                              &law->rests, &law->of_joints, &law->active, &law->taken};
  const size_t count = (size_t)n;
  double *x = tl_take(&s->work, 26 * count, sizeof(double));
  uint8_t *mark = tl_take(&s->work, 8 * count, 1);
  if (!x || !mark) return TL_NO_MEMORY;
  memset(x, 0, 26 * count * sizeof(double));
  memset(mark, 0, 8 * count);
  for (int k = 0; k < 6; k++, x += 3 * count) *vectors[k] = x;
  for (int k = 0; k < 8; k++, x += count) *numbers[k] = x;
  for (int k = 0; k < 8; k++, mark += count) *marks[k] = mark;
  law->n = n;
  return TL_FINE;
}

/* The number of a key in a memory, whose keys rise; -1 where it is not there. */
static int place_of(const tl_memory *memory, int64_t key) {
  int low = 0, high = memory->count;
  while (low < high) {
    const int middle = (low + high) / 2;
    if (memory->keys[middle] < key) low = middle + 1;
    else high = middle;
  }
  return low < memory->count && memory->keys[low] == key ? low : -1;
}

/* The end of the points of a pair that begin at a number: they follow each other. */
static int end_of_pair(const tl_law *law, int first) {
  int end = first + 1;
  while (end < law->n && law->points[end].pair == law->points[first].pair) end++;
  return end;
}

/* Make active of each pair the points that end lowest, below a limit: of the four that do, with 0 in place of the ends of what
is active. Returns how many are new. */
static int activate_lowest(tl_law *law, double limit, int none_of_active) {
  int fresh = 0;
  memset(law->taken, 0, (size_t)law->n);
  for (int first = 0, end; first < law->n; first = end) {
    end = end_of_pair(law, first);
    for (int rank = 0; rank < TL_FACE; rank++) {
      int best = -1;
      double low = limit;
      for (int k = first; k < end; k++) {
        const double at = none_of_active && law->active[k] ? 0.0 : law->ends[k];
        if (!law->taken[k] && at < low) low = at, best = k;
      }
      if (best < 0) break;
      law->taken[best] = 1;
      fresh += !law->active[best];
    }
  }
  for (int k = 0; k < law->n; k++) law->active[k] |= law->taken[k];
  return fresh;
}

/* When in the step a point meets, and what impulses there do; its gap at the begin. still: it was, and counts as closed. */
static double meet(const tl_scene *s, tl_law *law, int k, int still) {
  const double *before = law->before + 3 * k, *after = law->after + 3 * k, h = law->h, gap = law->points[k].gap;
  const int pair = law->points[k].pair;
  const double e = s->restitution[pair], b = (before[2] - after[2]) / h, approach = -before[2];
  law->hits[k] = !law->known[k] && approach > tl_larger(b * h, TL_STILL);
  const double start = tl_larger(gap + 0.5 * h * approach, 0.0), u = law->hits[k] ? approach : 1.0;
  const double time = tl_limited(2.0 * start / (u + sqrt(tl_larger(u * u + 2.0 * b * start, 0.0))), 0.0, h);
  const double left = h - time, meets = u + b * time;
  law->rebound[k] = e * meets - b * left;
  law->bounces[k] = law->hits[k] && e > 0.0 && meets > s->threshold[pair] && law->rebound[k] > 0.0;
  const double leaves = law->hits[k] ? e * meets : law->known[k] && e > 0.0 ? tl_larger(before[2], -e * before[2]) : 0.0;
  if (!law->bounces[k] && leaves > TL_STILL && b > 0.0) law->heights[k] = leaves * leaves / (2.0 * b);
  const double turn = law->bounces[k] ? 2.0 * time / h - 1.0 : 0.0;
  for (int i = 0; i < 3; i++) law->sums[3 * k + i] = before[i] + turn * (after[i] - before[i]);
  law->given[k] = h * s->pressing[pair];
  law->rests[k] = law->given[k] == 0.0;
  law->of_joints[k] = law->points[k].dof >= 0;
  law->open[k] = law->hits[k] || still ? 0.0 : 2.0 / h * tl_larger(gap, 0.0);
  const double pressing = (meets * left + 0.5 * b * left * left) / tl_larger(u + b * h, TL_STILL) - 0.5 * h;
  const double late = law->bounces[k] ? 0.5 * h - time : tl_limited(pressing, -0.5 * h, 0.5 * h);
  law->late[k] = law->hits[k] ? late : 0.0;
  law->slower[k] = s->friction[pair];
  law->mu[k] = law->stuck[k] ? s->fixed[pair] : law->slower[k];
  return start;
}

/* The laws of the scene's points in a step that begins with v and would end with `free` without impulses. last: those of the same
points, whose impulses are those to begin with, of points that are active; NULL: those of the last step. */
int tl_new_law(tl_scene *s, double h, const double *v, const double *free, tl_row *rows, const tl_memory *memory,
               const tl_law *last, tl_law *law) {
  const int code = take(s, law, s->count);
  if (code) return code;
  law->h = h, law->share = 1.0, law->points = s->points, law->rows = rows;
  uint8_t *still = law->taken; /* until it is needed */
  tl_speeds(s, law->points, rows, law->n, v, law->before);
  tl_speeds(s, law->points, rows, law->n, free, law->after);
  for (int k = 0; k < law->n; k++) {
    const int place = place_of(memory, law->points[k].key);
    if (place < 0) continue;
    law->known[k] = 1, law->stuck[k] = memory->stuck[place], still[k] = memory->still[place];
    for (int i = 0; i < 3; i++) law->guess[3 * k + i] = law->lasting[3 * k + i] = h * memory->forces[3 * place + i];
  }
  if (last) memcpy(law->guess, last->guess, 3 * (size_t)law->n * sizeof(double));
  double *begins = law->ends; /* until they are needed */
  for (int first = 0, end; first < law->n; first = end) {
    int count = 0;
    double least = INFINITY;
    end = end_of_pair(law, first);
    for (int k = first; k < end; k++) count += still[k];
    for (int k = first; k < end; k++) { /* of a face's corners, not all motions that their gaps ask for are possible */
      const double gap = law->points[k].gap;
      begins[k] = meet(s, law, k, (still[k] && (count > 1 || gap < TL_TOUCHING)) || gap < TL_CLOSED);
      if (law->hits[k] && begins[k] < least) least = begins[k];
    }
    for (int k = first; k < end; k++) /* what meets later in the step than the first, as if at once */
      if (law->hits[k] && !law->bounces[k]) law->heights[k] = tl_larger(law->heights[k], begins[k] - least);
  }
  for (int k = 0; k < law->n; k++) {
    law->ends[k] = law->points[k].gap + 0.5 * h * law->after[3 * k + 2];
    law->active[k] = law->known[k] || (last && last->guess[3 * k + 2] > 0.0);
  }
  /* What these hold up needs no impulse of its own. */
  activate_lowest(law, TL_CLOSED, 0);
  return TL_FINE;
}

/* Let points that end too low without an impulse be active too, and points that slip have less friction; how many there were. */
int tl_missed(tl_scene *s, tl_law *law, const tl_solution *found) {
  int changed = 0;
  for (int i = 0; i < found->count; i++) {
    const int k = found->active[i];
    const double *u = found->u + 3 * i;
    if (!(law->mu[k] > law->slower[k] && sqrt(u[0] * u[0] + u[1] * u[1]) > TL_STILL)) continue;
    law->mu[k] = law->slower[k], changed++;
  }
  tl_speeds(s, law->points, law->rows, law->n, found->ends, law->moves);
  for (int k = 0; k < law->n; k++) law->ends[k] = law->points[k].gap + 0.5 * law->h * law->moves[3 * k + 2];
  return changed + activate_lowest(law, -TL_CLOSED, 1);
}

/* By how much the heights that are not followed would move a joint at most, rad or m: M^-1 J_n^T z / G_nn of a height z. */
int tl_unfollowed(tl_scene *s, const tl_law *law, const tl_solution *found, double *out) {
  static const double NORMAL[3] = {0, 0, 1};
  double *x = tl_take(&s->work, (size_t)s->nv, sizeof(double));
  if (!x) return TL_NO_MEMORY;
  for (int i = 0; i < found->count; i++) {
    const int k = found->active[i];
    double most = 0.0, u[3];
    if (!(law->heights[k] > 0.0 && found->p[3 * i + 2] > 0.0)) continue;
    memset(x, 0, (size_t)s->nv * sizeof(double));
    tl_add_row(law->rows + k, law->rows[k].y, NORMAL, x);
    tl_outward(s, x);
    tl_row_times(law->rows + k, x, u);
    for (int d = 0; d < s->nv; d++) most = tl_larger(most, fabs(x[d]));
    *out = tl_larger(*out, most * law->heights[k] / u[2]);
  }
  return TL_FINE;
}
