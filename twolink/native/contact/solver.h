/* The contact problem of a step: rows of points, equations with G, and impulses. See contact/impulses.py. */
#ifndef TWOLINK_CONTACT_SOLVER_H
#define TWOLINK_CONTACT_SOLVER_H
#include "scene.h"

/* A node: up to six degrees of freedom, in eight numbers. A block of two, and what a block of three rows has of Y at one. */
enum { TL_NODE = 6, TL_LANES = 8, TL_BLOCK = TL_NODE * TL_LANES, TL_PART = 3 * TL_LANES };

/* Equations (E + C G) p = f of points, or blocks of three rows, see blocks.c. Of block i the parts first[i] to first[i + 1] of Y
(TL_PART), each at a node. mass, x (nodes, TL_LANES): D, and a motion. Node k has `used` of its degrees of freedom, and blocks of L and U with the nodes
below[start[k]] to below[start[k + 1]], which come later. inverse, coupling (points, 9): E^-1 and E^-1 C. */
typedef struct {
  int points, nodes;
  int32_t *first, *node, *start, *below, *at, *next, *after, *waiting, *order, *used;
  double *y, *mass, *x, *own, *lower, *upper, *inverse, *coupling;
} tl_system;

/* Where a point stands in equations: its block, and of a joint's point the row in it, and which of the point's own it is; own -1:
of a contact, all three. */
typedef struct {
  int32_t block, row, own;
} tl_place_in;

/* U = G p + b, of blocks of three rows: a contact, with its friction mu (n), or, where mu is negative, stops and dry friction of up
to three joints, whose impulses have bounds (n, 3, 2). size (n): the largest entry of G on the diagonal. fastest, scale: velocities. */
typedef struct {
  tl_system g;
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

int tl_new_system(tl_scene *s, const tl_row *const *rows, const tl_place_in *places, int n, int blocks, tl_system *out);
void tl_system_diagonal(const tl_system *a, int i, double *out);

/* What is compiled for each level of a processor. */
#define TL_DECLARE_SYSTEM(L)                                                    \
  int tl_factor_system_##L(const tl_system *a);                                 \
  void tl_solve_system_##L(const tl_system *a, double *p);                      \
  void tl_system_times_##L(const tl_system *a, const double *p, double *out);
int tl_factor_system(int level, const tl_system *a);
void tl_solve_system(int level, const tl_system *a, double *p);
void tl_system_times(int level, const tl_system *a, const double *p, double *out);

int tl_problem_sizes(tl_scene *s, tl_problem *problem);
int tl_solve_impulses(tl_scene *s, const tl_problem *problem, double *p, tl_answer *answer);
#endif
