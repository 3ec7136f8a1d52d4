/* The contact problem of a step: rows of points, blocks of G, and impulses. See contact/impulses.py. */
#ifndef TWOLINK_CONTACT_SOLVER_H
#define TWOLINK_CONTACT_SOLVER_H
#include "scene.h"

/* A matrix of blocks (3 x 3) in an envelope: of row i the blocks first[i] to i as three rows of numbers, which begin at[i] blocks
from the start. The upper triangle is the transpose, or of the same shape, by columns, in a second array. */
typedef struct {
  int n;
  int32_t *first;
  size_t *at;
  double *lower, *upper;
} tl_envelope;

/* U = G p + b, of blocks of three rows: a contact, with its friction mu (n), or, where mu is negative, stops and dry friction of up
to three joints, whose impulses have bounds (n, 3, 2). size (n): the largest entry of G on the diagonal. fastest, scale: velocities. */
typedef struct {
  tl_envelope g;
  double *b, *mu, *bounds, *size, fastest, scale;
} tl_problem;

/* What impulses miss: the residual, the feasibility and the complementarity, and what found them. */
typedef struct {
  double residual, feasibility, complementarity;
  int solver;
} tl_answer;

void tl_axes_of(const double *normal, double *axes);
void tl_speeds(tl_scene *s, const tl_point *points, const tl_row *rows, int n, const double *w, double *out);
void tl_row_times(const tl_row *row, const double *w, double *out);
void tl_add_row(const tl_row *row, const double *values, const double *p, double *out);
int tl_need_row(tl_scene *s, const tl_point *point, tl_row *row);
void tl_coupling(const tl_scene *s, const tl_row *a, const tl_row *b, double *out);
int tl_envelope_of(tl_scene *s, const tl_row *const *rows, int n, tl_envelope *out);

/* What is compiled for each level of a processor. */
#define TL_DECLARE_ENVELOPE(L)                                                        \
  int tl_factor_envelope_##L(const tl_envelope *a);                                   \
  void tl_solve_envelope_##L(const tl_envelope *a, double *x);                        \
  void tl_envelope_times_##L(const tl_envelope *g, const double *p, double *out);
int tl_factor_envelope(int level, const tl_envelope *a);
void tl_solve_envelope(int level, const tl_envelope *a, double *x);
void tl_envelope_times(int level, const tl_envelope *g, const double *p, double *out);

/* How many numbers a row of the blocks of row i has. */
static inline size_t tl_row_length(const tl_envelope *g, int i) { return 3 * (size_t)(i - g->first[i] + 1); }

/* Where block (i, j) of the lower triangle begins, or the transpose of (j, i) of the upper one, first[i] <= j <= i. */
static inline double *tl_block_at(const tl_envelope *g, double *triangle, int i, int j) {
  return triangle + 9 * g->at[i] + 3 * (size_t)(j - g->first[i]);
}

/* A block whose rows lie so many numbers apart. */
static inline void tl_get_block(const double *at, size_t apart, double *out) {
  for (int r = 0; r < 3; r++)
    for (int c = 0; c < 3; c++) out[3 * r + c] = at[(size_t)r * apart + (size_t)c];
}

static inline void tl_set_block(double *at, size_t apart, const double *block) {
  for (int r = 0; r < 3; r++)
    for (int c = 0; c < 3; c++) at[(size_t)r * apart + (size_t)c] = block[3 * r + c];
}

int tl_problem_sizes(tl_scene *s, tl_problem *problem);
int tl_solve_impulses(tl_scene *s, const tl_problem *problem, double *p, tl_answer *answer);
#endif
