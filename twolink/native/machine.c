/* What Python calls: programs on columns, methods, and their attempts, by the code for this processor. */
#include "program.h"

#include <stdlib.h>
#include <string.h>

#define ALL_WIDTHS(level) TL_DECLARE(w1##level) TL_DECLARE(w4##level) TL_DECLARE(w8##level) TL_DECLARE(w16##level)
#define TABLE(name, level) {name##_w1##level, 0, name##_w4##level, name##_w8##level, name##_w16##level}
typedef void (*columns_function)(const tl_program *, double *, int64_t, int, const tl_block *, int, const tl_block *);
typedef int64_t (*attempts_function)(tl_workspace *, int64_t, int64_t, int64_t, double *, const tl_disturbance *);
typedef int64_t (*ticks_function)(tl_workspace *, int64_t, int64_t, double *, const tl_disturbance *, tl_traced_law *);

ALL_WIDTHS(base)
#if defined(X86_LEVELS)
#include <cpuid.h>
ALL_WIDTHS(v3)
ALL_WIDTHS(v4)
static const columns_function COLUMNS[3][TL_WIDTHS] = {TABLE(tl_columns, base), TABLE(tl_columns, v3), TABLE(tl_columns, v4)};
static const attempts_function ATTEMPTS[3][TL_WIDTHS] = {TABLE(tl_attempts, base), TABLE(tl_attempts, v3),
                                                         TABLE(tl_attempts, v4)};
static const ticks_function TICKS[3][TL_WIDTHS] = {TABLE(tl_ticks, base), TABLE(tl_ticks, v3), TABLE(tl_ticks, v4)};
/* 2 with AVX-512 (F, DQ, CD, BW, VL), 1 with AVX2 and FMA, which the system must save too; else 0. */
static int level_of_processor(void) {
  unsigned a, b, c, d, low, high;
  if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & (1u << 27)) || !(c & (1u << 12))) return 0;
  __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
  if ((low & 6) != 6 || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & (1u << 5)) || !(b & (1u << 8))) return 0;
  const unsigned wanted = (1u << 16) | (1u << 17) | (1u << 28) | (1u << 30) | (1u << 31);
  return (low & 0xe6) == 0xe6 && (b & wanted) == wanted ? 2 : 1;
}
/* Asked once: in a virtual machine a cpuid takes as long as some hundred instructions of a program. Threads that ask at the
same time write the same. */
TL_API int tl_level(void) {
  static volatile int known = -1;
  if (known < 0) known = level_of_processor();
  return known;
}
#else
static const columns_function COLUMNS[1][TL_WIDTHS] = {TABLE(tl_columns, base)};
static const attempts_function ATTEMPTS[1][TL_WIDTHS] = {TABLE(tl_attempts, base)};
static const ticks_function TICKS[1][TL_WIDTHS] = {TABLE(tl_ticks, base)};
TL_API int tl_level(void) { return 0; }
#endif

#define TEXT_(x) #x
#define TEXT(x) TEXT_(x)
/* A digest of the sources that this was built from. */
TL_API const char *tl_sources(void) { return TEXT(SOURCES); }

TL_API int tl_fits(const tl_program *p, int width) { return p && tl_log2(width) >= 0 && p->code[tl_log2(width)] != NULL; }

TL_API double *tl_registers_new(const tl_program *p, int width) { return tl_fits(p, width) ? tl_registers(p, width) : NULL; }

TL_API void tl_registers_free(double *registers) { tl_free_aligned(registers); }

static int is_whole(const tl_block *blocks, int count, int wanted) {
  int64_t size = 0;
  if (count && !blocks) return 0;
  for (int i = 0; i < count; i++) {
    if (blocks[i].size < 0 || blocks[i].size > wanted || (blocks[i].size && !blocks[i].at)) return 0;
    size += blocks[i].size;
  }
  return size == wanted;
}

/* Outputs of `count` columns; registers: from tl_registers_new for this width. */
TL_API int tl_columns(const tl_program *p, int level, int width, double *registers, int64_t count, int inputs,
                      const tl_block *in, int outputs, const tl_block *out) {
  if (!p || !registers || count < 0 || count > TL_MAX_COUNT || level < 0 || level > tl_level() || inputs < 0 || outputs < 0 ||
      !is_whole(in, inputs, p->inputs) || !is_whole(out, outputs, p->outputs))
    return TL_BAD_ARGUMENT;
  if (!tl_fits(p, width)) return TL_TOO_WIDE;
  if (!tl_belong(registers, p, width)) return TL_BAD_ARGUMENT;
  COLUMNS[level][tl_log2(width)](p, registers, count, inputs, in, outputs, out);
  return TL_FINE;
}

TL_API void tl_method_free(tl_method *m) {
  if (!m) return;
  free(m->absolute);
  free(m->joint_rows);
  free(m->entry_at);
  free(m);
}

static int rows_are_sound(const tl_method *m) {
  for (int i = 0; i < 4 * m->joints; i++)
    if (m->joint_rows[i] < 0 || m->joint_rows[i] > m->moving) return 0;
  for (int i = 0; i < 2 * m->entries; i++)
    if (m->entry_at[i] < 0 || m->entry_at[i] >= m->moving) return 0;
  return 1;
}

/* sizes: size, moving, parameters, kind, adaptive, stages, errors, order, iterations, joints, entries of the Jacobian.
tableau: a (stages x stages), b, c, e (errors x stages). Returns a code; the method is written to `made`. The programs must
outlive it. */
TL_API int tl_method_new(const tl_program *rate, const tl_program *projection, const tl_program *jacobian,
                         const int32_t sizes[11], const double *tableau, const uint8_t *absolute, const int32_t *joint_rows,
                         const int32_t *entry_at, tl_method **made) {
  if (!made) return TL_BAD_ARGUMENT;
  *made = NULL;
  if (!sizes || !tableau || !absolute || !joint_rows || !entry_at) return TL_BAD_ARGUMENT;
  const int size = sizes[0], moving = sizes[1], parameters = sizes[2], kind = sizes[3], stages = sizes[5], errors = sizes[6];
  if (!rate || size < 0 || moving < 0 || moving > size || size > 30000 || parameters < 0 ||
      parameters > 65535 || stages < 0 || stages > TL_MAX_STAGES || errors < 0 || errors > TL_MAX_ERRORS || sizes[7] < 1 ||
      sizes[8] < 0 || sizes[8] > TL_MAX_ITERATIONS || sizes[9] < 0 || sizes[9] > size || sizes[10] < 0 ||
      sizes[10] > moving * moving || kind < TL_EXPLICIT || kind > TL_WHOLE || rate->inputs != 1 + size + parameters + (kind == TL_WHOLE) ||
      rate->outputs != moving || (projection && (projection->inputs != size + parameters || projection->outputs != moving)) ||
      (kind == TL_IMPLICIT) != (jacobian != NULL) ||
      (jacobian && (jacobian->inputs != 1 + size + parameters || jacobian->outputs != sizes[10])) || (kind != TL_WHOLE && !stages))
    return TL_BAD_ARGUMENT;
  tl_method *m = calloc(1, sizeof *m);
  if (!m) return TL_NO_MEMORY;
  m->rate = rate, m->projection = projection, m->jacobian = jacobian, m->size = size, m->moving = moving;
  m->parameters = parameters, m->kind = kind, m->adaptive = sizes[4], m->stages = stages, m->errors = errors;
  m->order = sizes[7], m->iterations = sizes[8], m->joints = sizes[9], m->entries = sizes[10];
  for (int i = 0; i < stages; i++) {
    for (int j = 0; j < stages; j++) m->a[i][j] = tableau[i * stages + j];
    m->b[i] = tableau[stages * stages + i];
    m->c[i] = tableau[stages * (stages + 1) + i];
    for (int e = 0; e < errors; e++) m->e[e][i] = tableau[stages * (stages + 2 + e) + i];
  }
  int failed = 0;
  m->absolute = tl_copied(absolute, (size_t)moving, &failed);
  m->joint_rows = tl_copied(joint_rows, (size_t)m->joints * 4 * sizeof(int32_t), &failed);
  m->entry_at = tl_copied(entry_at, (size_t)m->entries * 2 * sizeof(int32_t), &failed);
  if (failed || !rows_are_sound(m)) {
    tl_method_free(m);
    return failed ? TL_NO_MEMORY : TL_BAD_ARGUMENT;
  }
  *made = m;
  return TL_FINE;
}

TL_API void tl_workspace_free(tl_workspace *w) {
  if (!w) return;
  tl_free_aligned(w->memory);
  tl_free_aligned(w->rate_registers);
  tl_free_aligned(w->projection_registers);
  tl_free_aligned(w->jacobian_registers);
  free(w->pivots);
  free(w);
}

/* The numbers of one thread for a method; NULL without memory, or where a program is too large for the width. */
TL_API tl_workspace *tl_workspace_new(const tl_method *m, int width) {
  if (!m || !tl_fits(m->rate, width) || (m->projection && !tl_fits(m->projection, width)) ||
      (m->jacobian && !tl_fits(m->jacobian, width)))
    return NULL;
  tl_workspace *w = calloc(1, sizeof *w);
  if (!w) return NULL;
  const size_t lanes = (size_t)width, size = (size_t)m->size * lanes, moving = (size_t)m->moving * lanes;
  const size_t square = m->kind == TL_IMPLICIT ? moving * (size_t)m->moving : 0;
  const size_t stages = ((size_t)m->stages + 2) * moving;
  w->memory = tl_aligned((3 * size + moving + (TL_CONTROLS + (size_t)m->parameters) * lanes + stages + square +
                          (size_t)m->moving + 16) * sizeof(double));
  w->rate_registers = tl_registers(m->rate, width);
  w->projection_registers = m->projection ? tl_registers(m->projection, width) : NULL;
  w->jacobian_registers = m->jacobian ? tl_registers(m->jacobian, width) : NULL;
  w->pivots = calloc(moving ? moving : 1, sizeof(int32_t));
  if (!w->memory || !w->rate_registers || (m->projection && !w->projection_registers) ||
      (m->jacobian && !w->jacobian_registers) || !w->pivots) {
    tl_workspace_free(w);
    return NULL;
  }
  double *at = w->memory;
  w->method = m, w->width = width;
  w->x = at, at += size;
  w->next = at, at += size;
  w->change = at, at += size;
  w->control = at, at += TL_CONTROLS * lanes;
  w->parameters = at, at += (size_t)m->parameters * lanes;
  w->admitted = at, at += moving;
  w->stages = at, at += stages;
  w->matrix = at, at += square;
  w->right = at;
  return w;
}

/* Whether a disturbance has a row of its table for each attempt of each column: of the states, the control says how many were. */
static int is_within(const tl_disturbance *d, const tl_method *m, int64_t columns, const double *states) {
  const double *accepted = states + (m->size + 4) * columns, *rejected = accepted + columns;
  if (d->period < 1 || d->period > TL_MAX_COUNT || d->parts[0] < 0 || d->parts[1] > m->moving || d->parts[2] < 0 ||
      d->parts[3] > m->moving || !d->table || !d->rounding || !d->bias || !d->moves || !d->embedded || !d->first)
    return 0;
  for (int64_t i = 0; i < columns; i++)
    if (d->first[i] < 0 || d->first[i] > TL_MAX_COUNT || !(accepted[i] >= 0.0 && accepted[i] <= (double)TL_MAX_COUNT) ||
        !(rejected[i] >= 0.0 && rejected[i] <= (double)TL_MAX_COUNT))
      return 0;
  return 1;
}

static int may_begin(const tl_workspace *w, int level, int64_t columns, int64_t count, const double *states,
                     const tl_disturbance *disturbance) {
  if (!w || level < 0 || level > tl_level() || columns < 1 || count < 0 || !states) return 0;
  const int64_t most = TL_MAX_COUNT / (w->method->size + TL_CONTROLS + w->method->parameters);
  if (columns > most || count > most / columns) return 0;
  return !disturbance || is_within(disturbance, w->method, columns, states);
}

/* Attempts of each column of states (count + 1, rows, columns), whose first is given; how many were made, or a code below 0.
disturbance: arrays by column, or NULL. */
TL_API int64_t tl_attempts(tl_workspace *w, int level, int64_t columns, int64_t count, int64_t look, double *states,
                           const tl_disturbance *disturbance) {
  if (!may_begin(w, level, columns, count, states, disturbance) || look < 1) return -TL_BAD_ARGUMENT;
  return ATTEMPTS[level][tl_log2(w->width)](w, columns, count, look, states, disturbance);
}

/* Ticks of a law with the attempts between them, from states as those of tl_attempts; how many attempts were made. */
TL_API int64_t tl_ticks(tl_workspace *w, int level, int64_t columns, int64_t count, double *states,
                        const tl_disturbance *disturbance, tl_traced_law *law) {
  if (!may_begin(w, level, columns, count, states, disturbance) || !law || law->torques < 0 || law->torques > TL_MAX_COUNT ||
      law->kept < 0 || law->kept > TL_MAX_COUNT || law->ticks < 1 || law->ticks > TL_MAX_COUNT / columns || !law->held ||
      !law->limits || !law->times || !law->u || !law->z || !law->zeros || !law->at || !(law->call || law->program))
    return -TL_BAD_ARGUMENT;
  if (!law->call) {
    const tl_program *p = law->program;
    if (!law->registers || !law->rows || !tl_belong(law->registers, p, w->width) || p->inputs < 1 + law->kept ||
        p->outputs != law->torques + law->kept + 1)
      return -TL_BAD_ARGUMENT;
    for (int64_t i = 0; i < p->inputs - 1 - law->kept; i++)
      if (law->rows[i] < 0 || law->rows[i] >= w->method->size) return -TL_BAD_ARGUMENT;
  }
  for (int64_t i = 0; i < law->torques; i++)
    if (law->held[i] < w->method->moving || law->held[i] >= w->method->size) return -TL_BAD_ARGUMENT;
  law->done = 0;
  return TICKS[level][tl_log2(w->width)](w, columns, count, states, disturbance, law);
}
