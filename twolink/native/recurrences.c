/* The recurrences of a program: each instruction's, and those of the series that it needs. */
#include "taylor.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_TERMS = 16, MOST_RECURRENCES = 8, HIGHEST_POWER = 16 }; /* of one instruction */

typedef struct {
  const tl_program *program;
  tl_recurrences *made;
  int32_t *now, *scalar; /* the series that a register holds, and that of a scalar, or -1 */
  int unknown; /* an operation without a recurrence, or -1 */
} maker;

static int32_t new_series(maker *m, int constant) {
  m->made->is_constant[m->made->series] = (uint8_t)constant;
  return m->made->series++;
}

static int32_t literal(maker *m, double value) {
  tl_recurrences *r = m->made;
  r->literal[r->literals] = value;
  r->literal_at[r->literals++] = new_series(m, 1);
  return r->series - 1;
}

/* Enters a recurrence for a series. */
static tl_recurrence *entered(maker *m, int kind, int32_t result) {
  tl_recurrences *r = m->made;
  tl_recurrence *one = r->is_constant[result] ? &r->once[r->once_count++] : &r->each[r->each_count++];
  memset(one, 0, sizeof *one);
  one->kind = kind, one->result = result, one->first = r->terms_count;
  return one;
}

/* The series of a sum of terms. */
static int32_t sum(maker *m, const tl_term *terms, int count) {
  tl_recurrences *r = m->made;
  const uint8_t *constant = r->is_constant;
  tl_term sorted[4][MOST_TERMS]; /* constants, series, constants times series, series times series */
  int counts[4] = {0}, all = 1;
  for (int i = 0; i < count; i++) all &= constant[terms[i].a] && (terms[i].b < 0 || constant[terms[i].b]);
  for (int i = 0; i < count; i++) {
    tl_term term = terms[i];
    const int a = constant[term.a], b = term.b >= 0 && constant[term.b];
    int which = term.b < 0 ? !a || all : 3;
    if (term.b >= 0 && !all && a && b) {
      const tl_term factors = {term.a, term.b, 0};
      term.a = sum(m, &factors, 1), term.b = -1, which = 0;
    } else if (term.b >= 0 && !all && (a || b)) {
      which = 2;
      if (b) term.a = terms[i].b, term.b = terms[i].a;
    }
    sorted[which][counts[which]++] = term;
  }
  const int32_t result = new_series(m, all);
  tl_recurrence *one = entered(m, SERIES_SUM, result);
  for (int which = 0; which < 4; which++)
    for (int i = 0; i < counts[which]; i++) r->terms[r->terms_count++] = sorted[which][i];
  one->constants = counts[0], one->series = counts[1], one->scaled = counts[2], one->products = counts[3];
  return result;
}

static int32_t product(maker *m, int32_t a, int32_t b) {
  const tl_term term = {a, b, 0};
  return sum(m, &term, 1);
}

/* A series that is no constant: recurrences other than sums have only such ones, unless all of their operands are constant. */
static int32_t varying(maker *m, int32_t a, int all_constant) {
  if (all_constant || !m->made->is_constant[a]) return a;
  const int32_t result = new_series(m, 0);
  tl_recurrence *one = entered(m, SERIES_SUM, result);
  m->made->terms[m->made->terms_count++] = (tl_term){a, -1, 0};
  one->constants = 1;
  return result;
}

/* n a_n. */
static void times_order(maker *m, int32_t a, int32_t result) { entered(m, SERIES_TIMES_ORDER, result)->operands[0] = a; }

/* The series of a function of one or two others, whose recurrence is `kind`. second: that of a cosine. */
static int32_t function(maker *m, int kind, int32_t a, int32_t b, double exponent, int32_t *second) {
  const uint8_t *constant = m->made->is_constant;
  const int all = constant[a] && (b < 0 || constant[b]);
  a = varying(m, a, all), b = b < 0 ? b : varying(m, b, all);
  const int32_t result = new_series(m, all), own[4] = {new_series(m, all), new_series(m, all), new_series(m, all),
                                                       new_series(m, all)};
  int32_t square = -1;
  if (kind != SERIES_QUOTIENT && kind != SERIES_ROOT && kind < SERIES_LESS) times_order(m, a, own[0]);
  if (kind == SERIES_POWER) times_order(m, a, own[0]);
  if (kind == SERIES_ANGLE) {
    const tl_term terms[] = {{a, a, 0}, {b, b, 0}};
    times_order(m, b, own[1]);
    square = sum(m, terms, 2);
  }
  tl_recurrence *one = entered(m, kind, result);
  const int32_t operands[7] = {a, b, own[0], own[1], own[2], own[3], square};
  memcpy(one->operands, operands, sizeof operands);
  one->exponent = exponent;
  if (second) *second = own[1];
  if (kind == SERIES_ANGLE || kind == SERIES_POWER) times_order(m, result, own[2]);
  if (kind == SERIES_TANH) { /* own[1] = 1 - result^2 */
    tl_recurrence *slope = entered(m, SERIES_SUM, own[1]);
    const tl_term terms[] = {{literal(m, 1.0), -1, 0}, {result, result, 1}};
    for (int i = 0; i < 2; i++) m->made->terms[m->made->terms_count++] = terms[i];
    slope->constants = slope->products = 1;
  }
  return result;
}

static int32_t quotient(maker *m, int32_t a, int32_t b) {
  if (!m->made->is_constant[b] || m->made->is_constant[a]) return function(m, SERIES_QUOTIENT, a, b, 0.0, NULL);
  return product(m, a, function(m, SERIES_QUOTIENT, literal(m, 1.0), b, 0.0, NULL));
}

/* a^k: by products where k is a small whole number, as the general recurrence divides by a. */
static int32_t power(maker *m, int32_t a, double k) {
  if (k == 0.5) return function(m, SERIES_ROOT, a, -1, 0.0, NULL);
  if (k != rint(k) || fabs(k) > (double)HIGHEST_POWER) return function(m, SERIES_POWER, a, -1, k, NULL);
  int32_t result = -1, square = a;
  for (int left = (int)fabs(k); left; left >>= 1) {
    if (left & 1) result = result < 0 ? square : product(m, result, square);
    if (left > 1) square = product(m, square, square);
  }
  if (result < 0) return literal(m, 1.0);
  return k > 0 ? result : quotient(m, literal(m, 1.0), result);
}

static int32_t scalar(maker *m, int i) {
  if (m->scalar[i] < 0) m->scalar[i] = literal(m, m->program->scalar[i]);
  return m->scalar[i];
}

/* The terms of an instruction that is a sum; how many, 0 where it is none. */
static int terms_of(maker *m, int operation, const uint16_t *q, tl_term *t) {
  const int32_t *now = m->now;
#define PRODUCT(i, j, minus) (tl_term){now[q[i]], now[q[j]], minus}
#define SERIES(i, minus) (tl_term){now[q[i]], -1, minus}
#define SCALAR (tl_term){scalar(m, q[2]), -1, 0}
#define SCALED (tl_term){now[q[1]], scalar(m, q[2]), 0}
  switch (operation) {
    case ADD: return t[0] = SERIES(1, 0), t[1] = SERIES(2, 0), 2;
    case SUB: return t[0] = SERIES(1, 0), t[1] = SERIES(2, 1), 2;
    case MUL: return t[0] = PRODUCT(1, 2, 0), 1;
    case FMA: return t[0] = PRODUCT(1, 2, 0), t[1] = SERIES(3, 0), 2;
    case FMS: return t[0] = PRODUCT(1, 2, 0), t[1] = SERIES(3, 1), 2;
    case FNMA: return t[0] = PRODUCT(1, 2, 1), t[1] = SERIES(3, 0), 2;
    case ADD_K: return t[0] = SERIES(1, 0), t[1] = SCALAR, 2;
    case K_SUB: return t[0] = SERIES(1, 1), t[1] = SCALAR, 2;
    case MUL_K: return t[0] = SCALED, 1;
    case FMA_K: return t[0] = SCALED, t[1] = SERIES(3, 0), 2;
    case FMS_K: return t[0] = SCALED, t[1] = SERIES(3, 1), 2;
    case NEG: return t[0] = SERIES(1, 1), 1;
    case COPY: return t[0] = SERIES(1, 0), 1;
    case DOT2: return t[0] = PRODUCT(1, 2, 0), t[1] = PRODUCT(3, 4, 0), 2;
    case DOT2_MINUS: return t[0] = PRODUCT(1, 2, 0), t[1] = PRODUCT(3, 4, 1), 2;
    case E_DOT2: return t[0] = PRODUCT(1, 2, 0), t[1] = PRODUCT(3, 4, 0), t[2] = SERIES(5, 0), 3;
    case E_DOT2_MINUS: return t[0] = PRODUCT(1, 2, 0), t[1] = PRODUCT(3, 4, 1), t[2] = SERIES(5, 0), 3;
    case E_MINUS_DOT2: return t[0] = PRODUCT(1, 2, 1), t[1] = PRODUCT(3, 4, 1), t[2] = SERIES(5, 0), 3;
    case E_DOT3: return t[0] = PRODUCT(1, 2, 0), t[1] = PRODUCT(3, 4, 0), t[2] = SERIES(5, 0), t[3] = PRODUCT(6, 7, 0), 4;
    case E_DOT4:
      t[0] = PRODUCT(1, 2, 0), t[1] = PRODUCT(3, 4, 0), t[2] = SERIES(5, 0), t[3] = PRODUCT(6, 7, 0), t[4] = PRODUCT(8, 9, 0);
      return 5;
    default: return 0;
  }
#undef PRODUCT
#undef SERIES
#undef SCALAR
#undef SCALED
}

static void instruction(maker *m, int operation, const uint16_t *q) {
  int32_t *now = m->now;
  tl_term terms[MOST_TERMS];
  const int count = terms_of(m, operation, q, terms);
  if (count) {
    now[q[0]] = operation == COPY ? terms[0].a : sum(m, terms, count);
    return;
  }
  switch (operation) {
    case DIV: now[q[0]] = quotient(m, now[q[1]], now[q[2]]); break;
    case K_DIV: now[q[0]] = quotient(m, scalar(m, q[2]), now[q[1]]); break;
    case SQRT: now[q[0]] = function(m, SERIES_ROOT, now[q[1]], -1, 0.0, NULL); break;
    case EXP: now[q[0]] = function(m, SERIES_EXP, now[q[1]], -1, 0.0, NULL); break;
    case TANH: now[q[0]] = function(m, SERIES_TANH, now[q[1]], -1, 0.0, NULL); break;
    case ATAN2: now[q[0]] = function(m, SERIES_ANGLE, now[q[1]], now[q[2]], 0.0, NULL); break;
    case LESS: now[q[0]] = function(m, SERIES_LESS, now[q[1]], now[q[2]], 0.0, NULL); break;
    case LESS_EQUAL: now[q[0]] = function(m, SERIES_LESS_EQUAL, now[q[1]], now[q[2]], 0.0, NULL); break;
    case POWER: now[q[0]] = power(m, now[q[1]], m->program->scalar[q[2]]); break;
    case SINCOS: {
      int32_t cosine;
      const int32_t sine = function(m, SERIES_SINE, now[q[1]], -1, 0.0, &cosine);
      now[q[0]] = sine, now[q[2]] = cosine;
      break;
    }
    case WHERE: {
      const uint8_t *constant = m->made->is_constant;
      const int all = constant[now[q[1]]] && constant[now[q[2]]] && constant[now[q[3]]];
      const int32_t of[3] = {varying(m, now[q[1]], all), varying(m, now[q[2]], all), varying(m, now[q[3]], all)};
      const int32_t result = new_series(m, all);
      tl_recurrence *one = entered(m, SERIES_CHOICE, result);
      memcpy(one->operands, of, sizeof of);
      now[q[0]] = result;
      break;
    }
    default: m->unknown = operation;
  }
}

void tl_recurrences_free(tl_recurrences *r) {
  if (!r) return;
  free(r->once);
  free(r->each);
  free(r->terms);
  free(r->output);
  free(r->literal_at);
  free(r->is_constant);
  free(r->literal);
  free(r);
}

static int enough(maker *m, const tl_program *p) {
  tl_recurrences *r = m->made;
  size_t room = (size_t)p->inputs + (size_t)p->constants + (size_t)p->scalars + 16;
  for (size_t i = 0; i < p->quads;) {
    const size_t count = p->code[0][4 * i + 1];
    room += (p->code[0][4 * i] == POWER ? 16 : 1) * count * MOST_RECURRENCES;
    i += 1 + count * (size_t)tl_quads(p->code[0][4 * i]);
  }
  r->once = calloc(room, sizeof *r->once);
  r->each = calloc(room, sizeof *r->each);
  r->terms = calloc(2 * room, sizeof *r->terms);
  r->output = calloc((size_t)p->outputs + 1, sizeof *r->output);
  r->literal_at = calloc(room, sizeof *r->literal_at);
  r->is_constant = calloc(room + (size_t)p->outputs, sizeof *r->is_constant);
  r->literal = calloc(room, sizeof *r->literal);
  m->now = calloc((size_t)p->registers + 1, sizeof *m->now);
  m->scalar = malloc(((size_t)p->scalars + 1) * sizeof *m->scalar);
  return r->once && r->each && r->terms && r->output && r->literal_at && r->is_constant && r->literal && m->now && m->scalar;
}

/* The recurrences of a rate (t, x, constants) -> (x', rates beside it), whose x has `moving` rows. Returns a code; that of an
operation without a recurrence is TL_NO_SERIES and its number. They are written to `made`, to be freed in any case. */
int tl_recurrences_new(const tl_program *p, int moving, tl_recurrences **made) {
  maker m = {.program = p, .made = calloc(1, sizeof(tl_recurrences)), .unknown = -1};
  tl_recurrences *r = *made = m.made;
  const int there = r && enough(&m, p);
  if (there) {
    r->moving = moving, r->inputs = p->inputs, r->outputs = p->outputs;
    for (int i = 0; i < p->scalars; i++) m.scalar[i] = -1;
    for (int i = 0; i < p->inputs; i++) m.now[i] = new_series(&m, i > moving);
    for (int i = 0; i < p->constants; i++) m.now[p->constant_at[i]] = literal(&m, p->constant[i]);
    const uint16_t *q = p->code[0], *end = q + 4 * p->quads;
    while (q < end) {
      const int operation = q[0], quads = tl_quads(operation);
      int count = q[1];
      for (q += 4; count > 0; count--, q += 4 * quads) instruction(&m, operation, q);
    }
    for (int i = 0; i < p->outputs; i++) r->output[i] = m.now[p->output_at[i]];
  }
  free(m.now);
  free(m.scalar);
  return !there ? TL_NO_MEMORY : m.unknown < 0 ? TL_FINE : TL_NO_SERIES + m.unknown;
}
