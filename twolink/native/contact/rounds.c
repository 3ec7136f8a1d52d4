/* Points of balls, capsules, boxes and cylinders that touch with one point: RoundGap, BoxGap and CylinderGap of
geometry/gaps.py. Source: Ericson, Real-Time Collision Detection, 2005, chapter 5. */
#include "scene.h"
#include "vectors.h"

#define BURIED 1e-9   /* m: cores that are nearer have no normal */
#define PARALLEL 1e-9 /* the square of the sine between two segments below which they count as parallel */

/* s from -1 to 1 of the point s line of a segment that is nearest to a point. */
static double nearest_along(const double *line, const double *far) {
  return tl_limited(tl_dot(line, far) / tl_dot(line, line), -1, 1);
}

/* Offsets (s u, t w) of the nearest points of two segments from their middles; apart: of the middles. A half length 0 is a
point. */
static void nearest_of_segments(const double *apart, const double *u, const double *w, double *first, double *second) {
  const double a = tl_dot(u, u), b = tl_dot(u, w), c = tl_dot(w, w), d = tl_dot(u, apart), e = tl_dot(w, apart);
  double s = 0, t = 0;
  if (a > 0 && c > 0) {
    const double size = a * c - b * b, crossing = PARALLEL * a * c < size ? (b * e - c * d) / size : 0.0;
    t = tl_limited((b * tl_limited(crossing, -1, 1) + e) / c, -1, 1);
    s = tl_limited((b * t - d) / a, -1, 1);
  } else if (a > 0) {
    const double back[3] = {-apart[0], -apart[1], -apart[2]};
    s = nearest_along(u, back);
  } else if (c > 0) {
    t = nearest_along(w, apart);
  }
  for (int i = 0; i < 3; i++) first[i] = s * u[i], second[i] = t * w[i];
}

/* The offset of the point of a box that is nearest to a point `apart` from its middle. */
static void nearest_of_box(const tl_round *one, const double *r, const double *apart, double *out) {
  memset(out, 0, 3 * sizeof(double));
  for (int i = 0; i < 3; i++) {
    double e[3];
    tl_times(r, one->axes + 3 * i, e);
    tl_add_scaled(tl_limited(tl_dot(e, apart), -one->edges[i], one->edges[i]), e, out);
  }
}

/* The same of a cylinder: the point, limited along its axis and across it. */
static void nearest_of_cylinder(const tl_round *one, const double *r, const double *apart, double *out) {
  const double radius = one->edges[0], half = one->edges[1];
  double u[3], across[3];
  tl_times(r, one->axes, u);
  const double along = tl_dot(u, apart);
  tl_copy3(apart, across);
  tl_add_scaled(-along, u, across);
  const double square = tl_dot(across, across), share = radius * radius < square ? radius / sqrt(square) : 1.0;
  for (int i = 0; i < 3; i++) out[i] = tl_limited(along, -half, half) * u[i] + share * across[i];
}

/* The point of a pair, if it is nearer than the reach. Cores that overlap have no normal: the scene knows. */
static void detect(tl_scene *s, const tl_round *one, const double *a, const double *b, double reach) {
  const double *first = s->turned + 9 * one->first, *second = s->turned + 9 * one->second;
  double apart[3], on_first[3] = {0, 0, 0}, on_second[3] = {0, 0, 0}, line[3];
  tl_minus(a, b, apart);
  if (one->kind == TL_SEGMENTS) {
    double u[3], w[3];
    tl_times(first, one->half[0], u);
    tl_times(second, one->half[1], w);
    nearest_of_segments(apart, u, w, on_first, on_second);
  } else if (one->kind == TL_BALL_BOX) {
    nearest_of_box(one, second, apart, on_second);
  } else {
    nearest_of_cylinder(one, second, apart, on_second);
  }
  for (int i = 0; i < 3; i++) line[i] = apart[i] + on_first[i] - on_second[i];
  const double distance = tl_length(line), gap = distance - (one->radius[0] + one->radius[1]);
  if (!(gap < reach)) return;
  if (!(distance > BURIED)) {
    s->buried = 1;
    return;
  }
  tl_point point = {.key = tl_key(one->pair, 0), .pair = one->pair, .first = one->first, .second = one->second, .dof = -1,
                    .gap = gap};
  for (int i = 0; i < 3; i++) {
    point.normal[i] = line[i] / distance;
    point.position[i] = a[i] + on_first[i] - (one->radius[0] + 0.5 * gap) * point.normal[i];
  }
  tl_add_point(s, &point);
}

/* Whether two bodies may be nearer than a reach, by spheres around their origins; what is fixed may be anywhere. */
static int may_touch(const tl_scene *s, int a, int b, double reach) {
  const double limit = s->body[a].extent + s->body[b].extent + reach;
  double apart[3];
  tl_minus(s->origin + 3 * a, s->origin + 3 * b, apart);
  return !a || !b || tl_dot(apart, apart) < limit * limit;
}

/* The points of pairs whose bounding spheres are near. */
void tl_detect_rounds(tl_scene *s, double reach) {
  for (int k = 0; k < s->rounds; k++) {
    if (!may_touch(s, s->round_ends[2 * k], s->round_ends[2 * k + 1], reach)) continue;
    const tl_round *one = s->round + k;
    double a[3], b[3], apart[3];
    tl_at(s->turned + 9 * one->first, s->origin + 3 * one->first, one->centre[0], a);
    tl_at(s->turned + 9 * one->second, s->origin + 3 * one->second, one->centre[1], b);
    tl_minus(a, b, apart);
    const double limit = one->bound + reach;
    if (tl_dot(apart, apart) < limit * limit) detect(s, one, a, b, reach);
  }
}
