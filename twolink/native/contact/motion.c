/* Motion without contacts: the acceleration of a scene's bodies, and configurations that move. */
#include "scene.h"
#include "vectors.h"

#define SMALL 1e-7 /* rad^2: the square of half a turn whose sine is x - x^3 / 6 */

/* How many linear velocities a joint has along the axes of its fixed frame. */
static int moving_axes(const tl_body *body) { return body->kind == TL_FREE ? 3 : body->kind == TL_PLANAR ? 2 : 0; }

/* v of w: the linear velocities of free and planar joints along the axes of their body. */
static void to_local_velocity(const tl_scene *s, const double *w, double *v) {
  memcpy(v, w, (size_t)s->nv * sizeof(double));
  for (int b = 1; b < s->bodies; b++) {
    const tl_body *body = s->body + b;
    const int size = moving_axes(body);
    double x[3] = {0, 0, 0}, y[3];
    if (!size) continue;
    for (int k = 0; k < size; k++) tl_add_scaled(w[body->v + k], s->along + 3 * (body->v + k), x);
    tl_times_back(s->turned + 9 * b, x, y);
    for (int k = 0; k < size; k++) v[body->v + k] = y[k];
  }
}

/* Forces that belong to v as forces that belong to w. */
void tl_to_fixed_axes(const tl_scene *s, double *forces) {
  for (int b = 1; b < s->bodies; b++) {
    const tl_body *body = s->body + b;
    const int size = moving_axes(body);
    double x[3] = {0, 0, 0}, y[3];
    if (!size) continue;
    for (int k = 0; k < size; k++) x[k] = forces[body->v + k];
    tl_times(s->turned + 9 * b, x, y);
    for (int k = 0; k < size; k++) forces[body->v + k] = tl_dot(s->along + 3 * (body->v + k), y);
  }
}

/* Accelerations of linear velocities along axes that turn as those along axes that do not: omega x v is added. */
static void add_turning(const tl_scene *s, const double *w, double *a) {
  for (int b = 1; b < s->bodies; b++) {
    const tl_body *body = s->body + b;
    const int size = moving_axes(body);
    double linear[3] = {0, 0, 0}, angular[3] = {0, 0, 0}, x[3];
    if (!size) continue;
    for (int d = body->v; d < body->v + body->dofs; d++) {
      tl_add_scaled(w[d], s->along + 3 * d, linear);
      tl_add_scaled(w[d], s->about + 3 * d, angular);
    }
    tl_cross(angular, linear, x);
    for (int k = 0; k < size; k++) a[body->v + k] += tl_dot(s->along + 3 * (body->v + k), x);
  }
}

/* tau - h (nv) of the scene's program, of (t, q, v, numbers). */
static void forces_of_program(tl_scene *s, double t, const double *q, const double *w, const double *numbers, double *out) {
  double *x = s->input;
  x[0] = t;
  memcpy(x + 1, q, (size_t)s->nq * sizeof(double));
  to_local_velocity(s, w, x + 1 + s->nq);
  if (s->numbers) memcpy(x + 1 + s->nq + s->nv, numbers, (size_t)s->numbers * sizeof(double));
  const tl_block in = {x, 1, 1, s->program->inputs}, to = {out, 1, 1, s->program->outputs};
  tl_columns(s->program, s->level, 1, s->registers, 1, 1, &in, 1, &to);
}

/* w' (nv) without contacts in a step of length h, see contact/bodies.py; q is that of the last `tl_place`, and the mass matrix
that of the last `tl_factor`. */
void tl_free_acceleration(tl_scene *s, double t, const double *q, const double *w, double h, const double *ahead,
                          const double *numbers, double *out) {
  if (s->program) forces_of_program(s, t, q, w, numbers, out);
  else tl_minus_bias(s, w, out);
  if (h > 0.0)
    for (int k = 0; k < s->nv; k++) out[k] += s->viscosity[k] * ahead[k];
  if (s->program) tl_to_fixed_axes(s, out);
  tl_inward(s, out);
  tl_outward(s, out);
  if (s->program) add_turning(s, w, out);
}

/* omega x tau of free joints' torques, 0 elsewhere, see `Multibody.turning`. */
void tl_turning_forces(const tl_scene *s, const double *w, const double *forces, double *out) {
  memset(out, 0, (size_t)s->nv * sizeof(double));
  for (int b = 1; b < s->bodies; b++)
    if (s->body[b].kind == TL_FREE) {
      const int at = s->body[b].v + 3;
      tl_cross(w + at, forces + at, out + at);
    }
}

/* p * exp(turn / 2): a quaternion x, y, z, w after a turn about axes that move with it. */
static void rotated(const double *p, const double *turn, double *out) {
  const double square = 0.25 * tl_dot(turn, turn), half = sqrt(square), w = cos(half);
  const double share = 0.5 * (square < SMALL ? 1.0 - square / 6.0 + square * square / 120.0 : sin(half) / half);
  const double a = share * turn[0], b = share * turn[1], c = share * turn[2];
  const double x = w * p[0] + p[3] * a + p[1] * c - p[2] * b, y = w * p[1] + p[3] * b + p[2] * a - p[0] * c;
  const double z = w * p[2] + p[3] * c + p[0] * b - p[1] * a, last = w * p[3] - (p[0] * a + p[1] * b + p[2] * c);
  const double shorter = 1.5 - 0.5 * (x * x + y * y + z * z + last * last);
  out[0] = x * shorter, out[1] = y * shorter, out[2] = z * shorter, out[3] = last * shorter;
}

/* (cos, sin) after a turn. */
static void turned(const double *at, double angle, double *out) {
  const double c = cos(angle), s = sin(angle), x = at[0] * c - at[1] * s, y = at[1] * c + at[0] * s;
  const double shorter = 1.5 - 0.5 * (x * x + y * y);
  out[0] = x * shorter, out[1] = y * shorter;
}

/* The configuration after a time in which w adds up to a change (nv). */
void tl_moved(const tl_scene *s, const double *q, const double *change, double *out) {
  for (int b = 1; b < s->bodies; b++) {
    const tl_body *body = s->body + b;
    const double *from = q + body->q, *by = change + body->v;
    double *to = out + body->q;
    switch (body->kind) {
      case TL_FREE:
        for (int k = 0; k < 3; k++) to[k] = from[k] + by[k];
        rotated(from + 3, by + 3, to + 3);
        break;
      case TL_SPHERICAL: rotated(from, by, to); break;
      case TL_PLANAR:
        to[0] = from[0] + by[0], to[1] = from[1] + by[1];
        turned(from + 2, by[2], to + 2);
        break;
      case TL_CONTINUOUS: turned(from, by[0], to); break;
      default: to[0] = from[0] + by[0];
    }
  }
}
