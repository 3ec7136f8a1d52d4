/* Bodies: where they are, how they move, their mass matrix and their acceleration without contacts.

Velocities w are as in contact/bodies.py: linear ones of free and planar joints along the axes of the joint's fixed frame. A
degree of freedom d of a body moves it by `along` l_d at its origin p and turns it about `about` a_d, both along the world's
axes. All vectors of a body are about its own origin, so that no digits are lost far from the world's. */
#include "scene.h"
#include "vectors.h"

/* The rotation of a unit quaternion x, y, z, w. */
static void of_quaternion(const double *q, double *r) {
  const double x = q[0], y = q[1], z = q[2], w = q[3];
  r[0] = 1 - 2 * (y * y + z * z), r[1] = 2 * (x * y - z * w), r[2] = 2 * (x * z + y * w);
  r[3] = 2 * (x * y + z * w), r[4] = 1 - 2 * (x * x + z * z), r[5] = 2 * (y * z - x * w);
  r[6] = 2 * (x * z - y * w), r[7] = 2 * (y * z + x * w), r[8] = 1 - 2 * (x * x + y * y);
}

/* The rotation about a unit axis u with cosine c and sine s: u u^T (1 - c) + c + s [u x]. */
static void about_axis(const double *u, double c, double s, double *r) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) r[3 * i + j] = u[i] * u[j] * (1 - c) + (i == j ? c : 0);
  r[1] -= s * u[2], r[2] += s * u[1], r[5] -= s * u[0];
  r[3] += s * u[2], r[6] -= s * u[1], r[7] += s * u[0];
}

static void column(const double *r, int k, double *out) { out[0] = r[k], out[1] = r[3 + k], out[2] = r[6 + k]; }

/* The pose of a body and the axes of its joint's degrees of freedom, from the pose `fixed` of the joint's fixed frame. */
static void place_joint(tl_scene *s, int b, const double *fixed, const double *q) {
  static const double Z[3] = {0, 0, 1};
  const tl_body *body = s->body + b;
  double *r = s->turned + 9 * b, *p = s->origin + 3 * b, *along = s->along + 3 * body->v, *about = s->about + 3 * body->v;
  double own[9], shift[3];
  memset(along, 0, (size_t)body->dofs * 3 * sizeof(double));
  memset(about, 0, (size_t)body->dofs * 3 * sizeof(double));
  switch (body->kind) {
    case TL_FREE:
      of_quaternion(q + 3, own);
      tl_times(fixed, q, shift);
      tl_add_scaled(1, shift, p);
      for (int k = 0; k < 3; k++) column(fixed, k, along + 3 * k);
      break;
    case TL_SPHERICAL: of_quaternion(q, own); break;
    case TL_PLANAR:
      about_axis(Z, q[2], q[3], own);
      for (int k = 0; k < 2; k++) {
        column(fixed, k, along + 3 * k);
        tl_add_scaled(q[k], along + 3 * k, p);
      }
      column(fixed, 2, about + 6);
      break;
    case TL_REVOLUTE: about_axis(body->axis, cos(q[0]), sin(q[0]), own); break;
    case TL_CONTINUOUS: about_axis(body->axis, q[0], q[1], own); break;
    default: /* TL_PRISMATIC */
      memcpy(r, fixed, 9 * sizeof(double));
      tl_times(fixed, body->axis, along);
      tl_add_scaled(q[0], along, p);
      return;
  }
  tl_product(fixed, own, r);
  if (body->kind == TL_REVOLUTE || body->kind == TL_CONTINUOUS) tl_times(fixed, body->axis, about);
  if (body->kind == TL_FREE || body->kind == TL_SPHERICAL)
    for (int k = 0; k < 3; k++) column(r, k, about + 3 * (body->kind == TL_FREE ? 3 + k : k));
}

/* Poses of all bodies at q. */
void tl_place(tl_scene *s, const double *q) {
  s->placed++;
  for (int b = 1; b < s->bodies; b++) {
    const tl_body *body = s->body + b;
    double fixed[9];
    tl_product(s->turned + 9 * body->parent, body->rotation, fixed);
    tl_at(s->turned + 9 * body->parent, s->origin + 3 * body->parent, body->origin, s->origin + 3 * b);
    place_joint(s, b, fixed, q + body->q);
  }
}

/* The velocity that a joint gives its body: of the origin, and angular. */
static void own_velocity(const tl_scene *s, int b, const double *w, double *linear, double *angular) {
  memset(linear, 0, 3 * sizeof(double));
  memset(angular, 0, 3 * sizeof(double));
  for (int d = s->body[b].v; d < s->body[b].v + s->body[b].dofs; d++) {
    tl_add_scaled(w[d], s->along + 3 * d, linear);
    tl_add_scaled(w[d], s->about + 3 * d, angular);
  }
}

/* Velocities of all bodies. */
void tl_velocities(tl_scene *s, const double *w) {
  for (int b = 1; b < s->bodies; b++) {
    const int up = s->body[b].parent;
    double *linear = s->linear + 3 * b, *angular = s->angular + 3 * b, arm[3];
    own_velocity(s, b, w, linear, angular);
    tl_minus(s->origin + 3 * b, s->origin + 3 * up, arm);
    tl_add_cross(s->angular + 3 * up, arm, linear);
    for (int i = 0; i < 3; i++) linear[i] += s->linear[3 * up + i], angular[i] += s->angular[3 * up + i];
  }
}

/* The largest speed of a point of a shape, m/s: what the reach of a step is made of. */
double tl_fastest(tl_scene *s, const double *w) {
  double most = 0.0;
  tl_velocities(s, w);
  for (int b = 1; b < s->bodies; b++)
    most = tl_larger(most, tl_length(s->linear + 3 * b) + tl_length(s->angular + 3 * b) * s->body[b].extent);
  return most;
}

/* The force and the moment that a body needs to move as it does with w' = 0, and to stand against gravity. */
static void needed(tl_scene *s, int b) {
  const tl_body *body = s->body + b;
  const double *r = s->turned + 9 * b, *spin = s->angular + 3 * b, *turning = s->turning + 3 * b;
  double *force = s->force + 3 * b, *moment = s->moment + 3 * b, c[3], x[3], y[3], z[3];
  tl_times(r, body->centre, c);
  tl_cross(spin, c, x);
  tl_copy3(s->acceleration + 3 * b, force);
  tl_add_cross(turning, c, force);
  tl_add_cross(spin, x, force);
  for (int i = 0; i < 3; i++) force[i] *= body->mass;
  tl_times_back(r, spin, x); /* moments of inertia are along the body's axes */
  tl_times(body->inertia, x, y);
  tl_cross(x, y, z);
  tl_times_back(r, turning, x);
  tl_times(body->inertia, x, y);
  for (int i = 0; i < 3; i++) z[i] += y[i];
  tl_times(r, z, moment);
  tl_add_cross(c, force, moment);
}

/* -h (nv) along w: gravity and what velocities ask for (Newton and Euler's recursion: Featherstone 2008, section 5.3). */
void tl_minus_bias(tl_scene *s, const double *w, double *out) {
  tl_velocities(s, w);
  for (int i = 0; i < 3; i++) s->acceleration[i] = -s->gravity[i];
  for (int b = 1; b < s->bodies; b++) {
    const int up = s->body[b].parent;
    const double *spin = s->angular + 3 * up;
    double *a = s->acceleration + 3 * b, *turning = s->turning + 3 * b, linear[3], angular[3], arm[3], x[3];
    own_velocity(s, b, w, linear, angular);
    tl_minus(s->origin + 3 * b, s->origin + 3 * up, arm);
    tl_cross(spin, arm, x);
    tl_add_scaled(2, linear, x);
    tl_copy3(s->acceleration + 3 * up, a);
    tl_add_cross(s->turning + 3 * up, arm, a);
    tl_add_cross(spin, x, a);
    tl_copy3(s->turning + 3 * up, turning);
    tl_add_cross(spin, angular, turning);
    needed(s, b);
  }
  for (int b = s->bodies - 1; b > 0; b--) {
    const int up = s->body[b].parent;
    double arm[3];
    for (int d = s->body[b].v; d < s->body[b].v + s->body[b].dofs; d++)
      out[d] = -tl_dot(s->along + 3 * d, s->force + 3 * b) - tl_dot(s->about + 3 * d, s->moment + 3 * b);
    if (!up) continue;
    tl_minus(s->origin + 3 * b, s->origin + 3 * up, arm);
    for (int i = 0; i < 3; i++) s->force[3 * up + i] += s->force[3 * b + i], s->moment[3 * up + i] += s->moment[3 * b + i];
    tl_add_cross(arm, s->force + 3 * b, s->moment + 3 * up);
  }
}

/* An inertia about a point: mass, first moment, and the moments xx, xy, xz, yy, yz, zz. It is moved to a point from which it
lies `arm` away, and added. */
static void add_moved(const double *inertia, const double *arm, double *out) {
  const double m = inertia[0], *h = inertia + 1, *r = arm, hr = 2 * tl_dot(h, r) + m * tl_dot(r, r);
  out[0] += m;
  for (int i = 0; i < 3; i++) out[1 + i] += h[i] + m * r[i];
  out[4] += inertia[4] + hr - 2 * h[0] * r[0] - m * r[0] * r[0];
  out[5] += inertia[5] - h[0] * r[1] - h[1] * r[0] - m * r[0] * r[1];
  out[6] += inertia[6] - h[0] * r[2] - h[2] * r[0] - m * r[0] * r[2];
  out[7] += inertia[7] + hr - 2 * h[1] * r[1] - m * r[1] * r[1];
  out[8] += inertia[8] - h[1] * r[2] - h[2] * r[1] - m * r[1] * r[2];
  out[9] += inertia[9] + hr - 2 * h[2] * r[2] - m * r[2] * r[2];
}

/* The momentum of an inertia that moves by l and turns about a: force-like, and its moment. */
static void momentum(const double *inertia, const double *l, const double *a, double *force, double *moment) {
  const double *h = inertia + 1, *i = inertia + 4;
  for (int k = 0; k < 3; k++) force[k] = inertia[0] * l[k];
  tl_add_cross(a, h, force);
  tl_cross(h, l, moment);
  moment[0] += i[0] * a[0] + i[1] * a[1] + i[2] * a[2];
  moment[1] += i[1] * a[0] + i[3] * a[1] + i[4] * a[2];
  moment[2] += i[2] * a[0] + i[4] * a[1] + i[5] * a[2];
}

/* The inertia of each body, in the world's axes about its origin. */
static void own_inertias(tl_scene *s) {
  memset(s->composite, 0, (size_t)s->bodies * 10 * sizeof(double));
  for (int b = 1; b < s->bodies; b++) {
    const tl_body *body = s->body + b;
    const double *r = s->turned + 9 * b;
    double c[3], x[9], i[9], back[9];
    for (int j = 0; j < 3; j++)
      for (int k = 0; k < 3; k++) back[3 * j + k] = r[3 * k + j];
    tl_product(r, body->inertia, x);
    tl_product(x, back, i);
    tl_times(r, body->centre, c);
    const double own[10] = {body->mass, 0, 0, 0, i[0], i[1], i[2], i[4], i[5], i[8]};
    add_moved(own, c, s->composite + 10 * b);
  }
}

/* The mass matrix with armatures and half a step's viscosity, M + h D / 2 = L^T D L, sparse as the tree is: row d has the
degrees of freedom that d hangs on, by their depth (composite bodies and factors: Featherstone 2008, sections 6.2, 6.5). */
void tl_factor(tl_scene *s, double h) {
  own_inertias(s);
  for (int b = s->bodies - 1; b > 0; b--) {
    const tl_body *body = s->body + b;
    for (int d = body->v + body->dofs - 1; d >= body->v; d--) {
      double force[3], moment[3], arm[3], *row = s->factor + s->factor_at[d];
      momentum(s->composite + 10 * b, s->along + 3 * d, s->about + 3 * d, force, moment);
      int at = b;
      for (int j = d; j >= 0; j = s->dof_parent[j]) {
        if (s->dof_body[j] != at) {
          tl_minus(s->origin + 3 * at, s->origin + 3 * s->dof_body[j], arm);
          tl_add_cross(arm, force, moment);
          at = s->dof_body[j];
        }
        row[s->dof_depth[j]] = tl_dot(s->along + 3 * j, force) + tl_dot(s->about + 3 * j, moment);
      }
      row[s->dof_depth[d]] += s->armature[d] + 0.5 * h * s->viscosity[d];
    }
    if (body->parent) {
      double arm[3];
      tl_minus(s->origin + 3 * b, s->origin + 3 * body->parent, arm);
      add_moved(s->composite + 10 * b, arm, s->composite + 10 * body->parent);
    }
  }
  for (int k = s->nv - 1; k >= 0; k--) {
    double *own = s->factor + s->factor_at[k];
    s->inverse[k] = 1.0 / own[s->dof_depth[k]];
    for (int i = s->dof_parent[k]; i >= 0; i = s->dof_parent[i]) {
      const double a = own[s->dof_depth[i]] * s->inverse[k];
      double *row = s->factor + s->factor_at[i];
      for (int j = 0; j <= s->dof_depth[i]; j++) row[j] -= a * own[j];
      own[s->dof_depth[i]] = a;
    }
  }
}

/* x <- L^-T x. */
void tl_inward(const tl_scene *s, double *x) {
  for (int k = s->nv - 1; k >= 0; k--) {
    const double *row = s->factor + s->factor_at[k];
    for (int j = s->dof_parent[k]; j >= 0; j = s->dof_parent[j]) x[j] -= row[s->dof_depth[j]] * x[k];
  }
}

/* x <- L^-1 D^-1 x. */
void tl_outward(const tl_scene *s, double *x) {
  for (int k = 0; k < s->nv; k++) {
    const double *row = s->factor + s->factor_at[k];
    x[k] *= s->inverse[k];
    for (int j = s->dof_parent[k]; j >= 0; j = s->dof_parent[j]) x[k] -= row[s->dof_depth[j]] * x[j];
  }
}
