/* Steps: one, and one that may be taken as halves. See contact/stepping.py. */
#ifndef TWOLINK_CONTACT_STEP_H
#define TWOLINK_CONTACT_STEP_H
#include "contact_law.h"

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
int tl_advance(tl_scene *s, const tl_task *task, int depth, tl_ended *out);
int tl_is_finite(const double *x, int n);
#endif
