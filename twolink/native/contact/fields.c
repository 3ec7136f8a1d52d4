/* Points at which balls touch height fields of the world: geometry/on_fields.py and geometry/fields.py, whose names the
functions have, are the statement. Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.5. */
#include "scene.h"
#include "vectors.h"

#define SAME 1e-9   /* m */
#define LEVEL 1e-6  /* of normals */
#define FARTHER 4.0 /* times as deep as the surface below a ball's middle */

/* Cells first to end along x and y. */
typedef struct {
  int first[2], end[2];
} cells;

typedef struct {
  double corner[3][3], normal[3];
} triangle;

/* A number of cells from none to all, of what need not be finite. */
static int counted(double x, int most) { return x > 0 ? (x < most ? (int)x : most) : 0; }

static cells cells_within(const tl_field *f, const double *x, double near) {
  cells out;
  for (int i = 0; i < 2; i++) {
    const int most = f->count[i] - 1;
    out.first[i] = counted(floor((x[i] - near - f->origin[i]) / f->cell[i]), most);
    out.end[i] = counted(floor((x[i] + near - f->origin[i]) / f->cell[i]) + 1, most);
  }
  return out;
}

static void corner(const tl_field *f, int i, int k, double *out) {
  out[0] = i * f->cell[0] + f->origin[0], out[1] = k * f->cell[1] + f->origin[1];
  out[2] = f->height[(size_t)i * (size_t)f->count[1] + (size_t)k] + f->origin[2];
}

/* The triangle of a cell on the side of low y (0) or of low x (1). */
static triangle triangle_of(const tl_field *f, int i, int k, int half) {
  triangle out;
  double along[3], beside[3];
  corner(f, i, k, out.corner[0]);
  corner(f, i + 1, half ? k + 1 : k, out.corner[1]);
  corner(f, half ? i : i + 1, k + 1, out.corner[2]);
  tl_minus(out.corner[1], out.corner[0], along);
  tl_minus(out.corner[2], out.corner[0], beside);
  tl_cross(along, beside, out.normal);
  const double length = tl_length(out.normal);
  for (int c = 0; c < 3; c++) out.normal[c] /= length;
  return out;
}

/* Whether a triangle lies below a point, and which. */
static int below(const tl_field *f, const double *x, triangle *out) {
  int number[2];
  double at[2];
  for (int i = 0; i < 2; i++) {
    at[i] = (x[i] - f->origin[i]) / f->cell[i];
    if (!(at[i] >= 0 && at[i] <= f->count[i] - 1)) return 0;
    number[i] = counted(at[i], f->count[i] - 2);
  }
  *out = triangle_of(f, number[0], number[1], !(at[0] - number[0] >= at[1] - number[1]));
  return 1;
}

/* The height of a point above the plane of a triangle. */
static double height_above(const triangle *one, const double *x) {
  double away[3];
  tl_minus(x, one->corner[0], away);
  return tl_dot(one->normal, away);
}

/* The point of a triangle that is nearest to another one. */
static void nearest(const triangle *one, const double *x, double *out) {
  double least = INFINITY;
  int inside = 1;
  tl_copy3(one->corner[0], out);
  for (int j = 0; j < 3; j++) {
    double along[3], away[3], inward[3], on[3], far[3];
    tl_minus(one->corner[(j + 1) % 3], one->corner[j], along);
    tl_minus(x, one->corner[j], away);
    tl_cross(one->normal, along, inward);
    inside &= tl_dot(inward, away) >= 0;
    tl_copy3(one->corner[j], on);
    tl_add_scaled(tl_limited(tl_dot(away, along) / tl_dot(along, along), 0, 1), along, on);
    tl_minus(on, x, far);
    if (tl_dot(far, far) < least) {
      least = tl_dot(far, far);
      tl_copy3(on, out);
    }
  }
  if (!inside) return;
  tl_copy3(x, out);
  tl_add_scaled(-height_above(one, x), one->normal, out);
}

/* Whether the triangles at a point of the surface lie below the plane across n. */
static int supports(const tl_field *f, const double *p, const double *n) {
  const cells at = cells_within(f, p, SAME);
  for (int i = at.first[0]; i < at.end[0]; i++)
    for (int k = at.first[1]; k < at.end[1]; k++)
      for (int half = 0; half < 2; half++) {
        const triangle one = triangle_of(f, i, k, half);
        double off[3], way[3];
        nearest(&one, p, way);
        tl_minus(way, p, off);
        if (!(tl_dot(off, off) <= SAME * SAME)) continue;
        for (int j = 0; j < 3; j++) {
          tl_minus(one.corner[j], p, way);
          if (!(tl_dot(way, n) <= LEVEL * tl_length(way) + SAME * SAME)) return 0;
        }
      }
  return 1;
}

/* A point of a ball with its middle at x, a distance away from the surface. */
static void add(tl_scene *s, const tl_on_field *one, const double *x, double distance, const double *n) {
  tl_point point = {.pair = one->pair, .first = one->body, .dof = -1, .gap = distance - one->radius};
  tl_copy3(n, point.normal);
  tl_copy3(x, point.position);
  tl_add_scaled(-(one->radius + 0.5 * point.gap), n, point.position);
  tl_add_point(s, &point);
}

/* Whether a normal, to 6 digits, comes before another one. */
static int is_before(const double *n, const double *other) {
  for (int i = 0; i < 3; i++) {
    const double a = nearbyint(n[i] * 1e6), b = nearbyint(other[i] * 1e6);
    if (a != b) return a < b;
  }
  return 0;
}

/* The points from `begin` on by their normals, each of which stays once, and their keys. */
static void keep_each_once(tl_scene *s, int begin) {
  int kept = begin;
  for (int k = begin + 1; k < s->count; k++) {
    const tl_point point = s->points[k];
    int place = k;
    for (; place > begin && is_before(point.normal, s->points[place - 1].normal); place--)
      s->points[place] = s->points[place - 1];
    s->points[place] = point;
  }
  for (int k = begin; k < s->count; k++) {
    const double *n = s->points[k].normal;
    int seen = 0;
    for (int other = begin; other < kept && !seen; other++) {
      const double *m = s->points[other].normal;
      seen = fabs(n[0] - m[0]) < LEVEL && fabs(n[1] - m[1]) < LEVEL && fabs(n[2] - m[2]) < LEVEL;
    }
    if (seen) continue;
    s->points[kept] = s->points[k];
    s->points[kept].key = ((int64_t)s->points[k].pair << 32) + kept - begin;
    kept++;
  }
  s->count = kept;
}

/* The triangles that a ball, or a point, touches, each plane once. */
static void ball(tl_scene *s, const tl_on_field *one, double reach) {
  const tl_field *f = s->field + one->field;
  const int begin = s->count;
  triangle under;
  double x[3], on[3], way[3];
  tl_at(s->turned + 9 * one->body, s->origin + 3 * one->body, one->point, x);
  if (!(x[2] - one->radius - reach <= f->top)) return;
  const int is_over = below(f, x, &under);
  const double deep = is_over ? height_above(&under, x) : INFINITY;
  const int is_above = one->radius > 0 && deep > 0;
  const cells at = cells_within(f, x, one->radius + reach);
  for (int i = at.first[0]; i < at.end[0]; i++)
    for (int k = at.first[1]; k < at.end[1]; k++)
      for (int half = 0; half < 2; half++) {
        const triangle here = triangle_of(f, i, k, half);
        nearest(&here, x, on);
        const double height = height_above(&here, x);
        if (is_above) {
          tl_minus(x, on, way);
          const double far = tl_length(way);
          if (!(far - one->radius < reach)) continue;
          for (int c = 0; c < 3; c++) way[c] /= far;
          if (supports(f, on, way)) add(s, one, x, far, way);
        } else if (height - one->radius < reach && height >= FARTHER * (deep < 0 ? deep : 0) - SAME) {
          for (int c = 0; c < 3; c++) way[c] = x[c] - height * here.normal[c] - on[c];
          if (tl_length(way) <= SAME) add(s, one, x, height, here.normal);
        }
      }
  if (s->count == begin && is_over && !is_above && deep - one->radius < reach) add(s, one, x, deep, under.normal);
  keep_each_once(s, begin);
}

void tl_detect_fields(tl_scene *s, double reach) {
  for (const tl_on_field *one = s->on_field; one < s->on_field + s->on_fields; one++) ball(s, one, reach);
}
