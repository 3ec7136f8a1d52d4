/* Points at which bodies touch or are about to: of balls and rims over planes, of joints, and of shapes that have no formula
here, whose points the caller finds. See geometry/detection.py. */
#include "scene.h"
#include "vectors.h"

#include <stdlib.h>

#define FLAT 1e-9 /* of a rim: below it the disc lies flat on the plane */

/* Keep a point. Without memory it is left out, and the scene knows. */
void tl_add_point(tl_scene *s, const tl_point *point) {
  if (s->count == s->capacity) {
    const int more = 2 * s->capacity + 64;
    tl_point *points = more < (1 << 24) ? realloc(s->points, (size_t)more * sizeof(tl_point)) : NULL;
    if (!points) {
      s->short_of_memory = 1;
      return;
    }
    s->points = points, s->capacity = more;
  }
  s->points[s->count++] = *point;
}

/* A point of a body at x over a plane. */
static void add_on_plane(tl_scene *s, int pair, int feature, int body, double gap, const double *normal, const double *x) {
  tl_point point = {.key = tl_key(pair, feature), .pair = pair, .first = body, .dof = -1, .gap = gap};
  tl_copy3(normal, point.normal);
  tl_copy3(x, point.position);
  tl_add_scaled(-0.5 * gap, normal, point.position);
  tl_add_point(s, &point);
}

/* Balls over planes: gap = n . x - height - radius, with n in the body's axes, so that it is one sum for each ball. */
static void balls(tl_scene *s, double reach) {
  const double *restrict x = s->ball[0], *restrict y = s->ball[1], *restrict z = s->ball[2], *restrict radius = s->radius;
  double *restrict height = s->heights;
  for (const tl_on_plane *one = s->on_plane; one < s->on_plane + s->on_planes; one++) {
    const double *r = s->turned + 9 * one->body, *p = s->origin + 3 * one->body;
    const double low = tl_dot(one->normal, p) - one->height;
    double n[3];
    tl_times_back(r, one->normal, n);
    if (tl_dot(n, one->centre) + low - one->bound >= reach) continue;
    for (int k = one->first; k < one->end; k++) height[k] = n[0] * x[k] + n[1] * y[k] + n[2] * z[k] + low - radius[k];
    for (int k = one->first; k < one->end; k++)
      if (height[k] < reach) {
        const double own[3] = {x[k], y[k], z[k]};
        double at[3];
        tl_at(r, p, own, at);
        tl_add_scaled(-radius[k], one->normal, at);
        add_on_plane(s, one->pair, s->feature[k], one->body, height[k], one->normal, at);
      }
  }
}

/* Of the directions along a disc across its axis u: down a plane with the normal n, to the side, and back. Any where it lies
flat. */
void tl_rim_way(const double *n, const double *u, int way, double *out) {
  const double along = tl_dot(n, u);
  double down[3], side[3];
  for (int i = 0; i < 3; i++) down[i] = along * u[i] - n[i];
  if (!(tl_length(down) > FLAT)) {
    const double axis[3] = {fabs(u[0]) < 0.9, !(fabs(u[0]) < 0.9), 0};
    tl_cross(u, axis, down);
  }
  const double length = tl_length(down);
  for (int i = 0; i < 3; i++) down[i] /= length;
  tl_cross(u, down, side);
  for (int i = 0; i < 3; i++) out[i] = (way == 0 || way == 1 ? 1 : -1) * (way == 0 || way == 3 ? down : side)[i];
}

/* Rims over planes: the lowest point of each, the highest one, and those between; those of a pair follow each other. */
static void rims(tl_scene *s, double reach) {
  for (int k = 0, end; k < s->rims; k = end) {
    for (end = k + 1; end < s->rims && s->rim[end].pair == s->rim[k].pair;) end++;
    for (int way = 0; way < 4; way++)
      for (const tl_rim *rim = s->rim + k; rim < s->rim + end; rim++) {
        const double *r = s->turned + 9 * rim->body;
        double u[3], across[3], x[3];
        tl_times(r, rim->axis, u);
        tl_rim_way(rim->normal, u, way, across);
        tl_at(r, s->origin + 3 * rim->body, rim->point, x);
        tl_add_scaled(rim->radius, across, x);
        const double gap = tl_dot(rim->normal, x) - rim->height;
        if (gap < reach) add_on_plane(s, rim->pair, 4 * rim->feature + way, rim->body, gap, rim->normal, x);
      }
  }
}

/* Whether points that the caller finds are of the scene. */
static int is_sound(const tl_scene *s, const tl_found *found) {
  if (found->count < 0 || found->count > (1 << 24)) return 0;
  if (found->count && !(found->keys && found->pair && found->first && found->second && found->gap && found->normal &&
                        found->position))
    return 0;
  for (int64_t k = 0; k < found->count; k++)
    if (found->pair[k] < 0 || found->pair[k] >= s->pairs || found->first[k] < 0 || found->first[k] >= s->bodies ||
        found->second[k] < 0 || found->second[k] >= s->bodies)
      return 0;
  return 1;
}

/* The points with gaps below the reach, those of a pair one after the other. Where the caller fails, the scene knows. */
void tl_detect_others(tl_scene *s, double reach) {
  tl_found found = {0};
  if (!s->find) return;
  if (s->find(reach, 0, s->turned, s->origin, &found) || !is_sound(s, &found)) {
    s->buried = 1;
    return;
  }
  for (int64_t k = 0; k < found.count; k++) {
    tl_point point = {.key = found.keys[k], .pair = found.pair[k], .first = found.first[k], .second = found.second[k],
                      .dof = -1, .gap = found.gap[k]};
    tl_copy3(found.normal + 3 * k, point.normal);
    tl_copy3(found.position + 3 * k, point.position);
    tl_add_point(s, &point);
  }
}

/* The largest overlap that the caller finds, m. */
double tl_overlap_of_others(tl_scene *s) {
  tl_found found = {0};
  if (!s->find) return 0.0;
  if (s->find(0.0, 1, s->turned, s->origin, &found)) s->buried = 1;
  return found.overlap;
}

/* The points of bodies with gaps below the reach. */
void tl_detect(tl_scene *s, double reach) {
  s->count = s->buried = 0;
  balls(s, reach);
  rims(s, reach);
  tl_detect_fields(s, reach);
  tl_detect_rounds(s, reach);
  tl_detect_hulls(s, reach);
  tl_detect_others(s, reach);
}

/* The points of stops and of dry friction, behind those of bodies. */
void tl_joint_gaps(tl_scene *s, const double *q) {
  for (int k = 0; k < s->joint_points; k++) {
    const tl_joint_point *joint = s->joint_point + k;
    const int pair = s->pairs + k;
    tl_point point = {.key = tl_key(pair, 0), .pair = pair, .dof = joint->dof, .sign = joint->side, .normal = {0, 0, 1}};
    if (joint->is_stop) point.gap = joint->side * (q[joint->entry] - joint->position);
    tl_add_point(s, &point);
  }
}

/* The largest overlap of bodies, m, with those of joints with their stops where q is given. The poses are those of the last
`tl_place`. The points are lost. */
double tl_overlap(tl_scene *s, const double *q) {
  double most = tl_larger(tl_hull_overlap(s), tl_overlap_of_others(s));
  s->count = 0;
  balls(s, 0.0);
  rims(s, 0.0);
  tl_detect_fields(s, 0.0);
  tl_detect_rounds(s, 0.0);
  if (q) tl_joint_gaps(s, q);
  for (int k = 0; k < s->count; k++) most = tl_larger(most, -s->points[k].gap);
  return most;
}
