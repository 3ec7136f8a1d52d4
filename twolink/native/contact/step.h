/* Steps: one, and one that may be taken as halves (contact/stepping.py), the laws of their points and what obeys them
(contact/step_law.py). */
#ifndef TWOLINK_CONTACT_STEP_H
#define TWOLINK_CONTACT_STEP_H
#include "solver.h"

enum { TL_HALVE = -1 }; /* in place of a code: the laws are not reached in a step of this length */

/* Points (n) of a step of length h. before, after, guess, lasting, sums: (n, 3); moves: of a last motion. */
typedef struct {
  int n;
  double h, share;
  const tl_point *points;
  tl_row *rows;
  double *before, *after, *guess, *lasting, *sums, *moves, *rebound, *open, *late, *heights, *given, *mu, *slower, *ends;
  uint8_t *known, *stuck, *hits, *bounces, *rests, *of_joints, *active, *taken;
} tl_law;

/* Active points (count), in the order of their islands, with P and U + c (count, 3), and v+ (nv). bounces: whether one does. */
typedef struct {
  int count, bounces;
  int32_t *active;
  double *p, *u, *ends;
  tl_answer answer;
} tl_solution;

/* A point with its island and its later body: what its place in a problem is by. */
typedef struct {
  int32_t island, body, point;
} tl_place_of;

int tl_in_order(tl_scene *s, const tl_law *law, const uint8_t *marked, tl_place_of **order, int *size);
int tl_new_law(tl_scene *s, double h, const double *v, const double *free, tl_row *rows, const tl_memory *memory,
               const tl_law *last, tl_law *law);
int tl_missed(tl_scene *s, tl_law *law, const tl_solution *found);
int tl_solve_law(tl_scene *s, tl_law *law, const double *free, tl_solution *out);
int tl_without_gain(tl_scene *s, tl_law *law, const double *free, tl_solution *out);
int tl_unfollowed(tl_scene *s, const tl_law *law, const tl_solution *found, double *out);
int tl_correction(tl_scene *s, const tl_law *law, const double *off, const uint8_t *lasts, double *push);

/* A step to take, from (q, v) and a memory on, with numbers that hold. */
typedef struct {
  double t, h;
  const double *q, *v, *numbers;
  const tl_memory *memory;
} tl_task;

double tl_reach(double h, double fastest);
int tl_end_of_step(tl_scene *s, const tl_task *task, tl_law *law, const double *free, const double *middle, tl_ended *out);
int tl_new_memory(tl_scene *s, int count, tl_memory *out);
void tl_pass_change(const tl_scene *s, const tl_memory *memory, const double *mean, int smooth, tl_memory *out);
int tl_step(tl_scene *s, const tl_task *task, tl_ended *out);
int tl_advance(tl_scene *s, const tl_task *task, int depth, int bounces, tl_ended *out);
int tl_is_finite(const double *x, int n);
#endif
