/* Points at which bodies touch height fields of the world: geometry/on_fields.py, whose names the functions have, is the
statement. */
#include "fields.h"

#define BESIDE 0.1 /* of a radius: points of a capsule's end and of its side that are nearer are one */

static int64_t key(const tl_field_body *b, int part, int64_t number) {
  return tl_key(b->one->pair, part * 2 * tl_planes(b->f) + number);
}

/* A point of a part of the body with its middle at x + far n. */
void tl_add_on_field(const tl_field_body *b, int part, int64_t number, double gap, const double *n, const double *x,
                     double far) {
  tl_point point = {.key = key(b, part, number), .pair = b->one->pair, .first = b->one->body, .dof = -1, .gap = gap};
  tl_copy3(n, point.normal);
  tl_copy3(x, point.position);
  tl_add_scaled(far, n, point.position);
  tl_add_point(b->s, &point);
}

int tl_same_way(const double *n, const double *m) {
  return fabs(n[0] - m[0]) < TL_LEVEL && fabs(n[1] - m[1]) < TL_LEVEL && fabs(n[2] - m[2]) < TL_LEVEL;
}

/* The points of a part from `begin` on: one of each plane, and one in each direction. */
void tl_each_once(tl_scene *s, int begin) {
  tl_point *points = s->points;
  int kept = begin;
  for (int k = begin + 1; k < s->count; k++) {
    const tl_point point = points[k];
    int place = k;
    for (; place > begin; place--) {
      const tl_point *before = points + place - 1;
      if (before->key < point.key || (before->key == point.key && before->gap <= point.gap)) break;
      points[place] = *before;
    }
    points[place] = point;
  }
  for (int k = begin; k < s->count; k++) {
    int other = begin;
    while (other < kept && points[k].key != points[other].key && !tl_same_way(points[k].normal, points[other].normal)) other++;
    if (other == kept) points[kept++] = points[k];
  }
  s->count = kept;
}

/* The number of a point with a triangle: of the plane, or of the triangle whose edge it is on. */
int64_t tl_plane_number(const tl_field *f, const tl_triangle *one, int is_edge) {
  const int triangles = 2 * (f->count[0] - 1) * (f->count[1] - 1);
  return tl_planes(f) + (is_edge ? triangles + one->number : f->plane_of[one->number]);
}

/* The triangles that a corner or ball touches. */
static void on_corner(const tl_field_body *b, int part, const double *x) {
  const double radius = b->one->radius;
  const int begin = b->s->count;
  int held = 0; /* whether a triangle is as near as that below */
  tl_triangle under;
  double on[3], way[3];
  const int is_over = tl_below(b->f, x, &under);
  const double deep = is_over ? tl_height_above(&under, x) : INFINITY;
  const int is_above = radius > 0 && deep > 0;
  const tl_cells at = tl_cells_within(b->f, x, radius + b->reach);
  for (int i = at.first[0]; i < at.end[0]; i++)
    for (int k = at.first[1]; k < at.end[1]; k++)
      for (int half = 0; half < 2; half++) {
        const tl_triangle here = tl_triangle_of(b->f, i, k, half);
        tl_nearest_of_triangle(&here, x, on);
        double gap = tl_height_above(&here, x) - radius;
        if (is_above) {
          tl_minus(x, on, way);
          const double far = tl_length(way);
          gap = far - radius;
          if (!(gap < b->reach)) continue;
          for (int c = 0; c < 3; c++) way[c] /= far;
          const int64_t number = tl_plane_number(b->f, &here, !tl_same_way(way, here.normal));
          if (tl_supports(b->f, on, way)) tl_add_on_field(b, part, number, gap, way, x, -(radius + 0.5 * gap));
        } else if (gap < b->reach && gap + radius >= TL_FARTHER * (deep < 0 ? deep : 0) - TL_SAME) {
          for (int c = 0; c < 3; c++) way[c] = x[c] - (gap + radius) * here.normal[c] - on[c];
          if (!(tl_length(way) <= TL_SAME)) continue;
          tl_add_on_field(b, part, tl_plane_number(b->f, &here, 0), gap, here.normal, x, -(radius + 0.5 * gap));
          held |= gap + radius <= (deep > 0 ? deep : 0) + TL_SAME;
        }
      }
  const double gap = deep - radius;
  if (is_over && !is_above && !held && gap < b->reach)
    tl_add_on_field(b, part, tl_plane_number(b->f, &under, 0), gap, under.normal, x, -(radius + 0.5 * gap));
  tl_each_once(b->s, begin);
}

/* s and t of the points x + s u of a line and start + t way of a ridge that are nearest to each other, if they cross. */
static int crossing(const double *x, const double *u, const tl_spot *ridge, double *s, double *t) {
  double apart[3];
  tl_minus(x, ridge->start, apart);
  const double a = tl_dot(u, u), b = tl_dot(u, ridge->way), c = tl_dot(ridge->way, ridge->way);
  const double d = tl_dot(u, apart), e = tl_dot(ridge->way, apart), size = a * c - b * b;
  if (!(size > TL_LEVEL * TL_LEVEL * a * c)) return 0;
  *s = (b * e - c * d) / size, *t = (a * e - b * d) / size;
  return 1;
}

/* Leave out points at which the balls of a capsule touch edges where the side, which is nearer, touches at x. */
static void leave_out(const tl_field_body *b, const double *x) {
  const int64_t edges = tl_planes(b->f) + 2 * (b->f->count[0] - 1) * (b->f->count[1] - 1);
  int kept = b->begin;
  for (int k = b->begin; k < b->s->count; k++) {
    const int64_t number = b->s->points[k].key - key(b, 0, 0), all = 2 * tl_planes(b->f);
    double apart[3];
    tl_minus(b->s->points[k].position, x, apart);
    if (number / all < TL_SIDE && number % all >= edges && tl_length(apart) < BESIDE * b->one->radius) continue;
    b->s->points[kept++] = b->s->points[k];
  }
  b->s->count = kept;
}

/* A ridge or peak at which the side of a capsule touches, or of a cylinder, which has rims. */
static void on_line(const tl_field_body *b, const tl_spot *at) {
  const double *start = b->ends[0];
  double way[3], p[3], line[3], s, t;
  tl_minus(b->ends[1], start, way);
  tl_copy3(at->start, p);
  if (!at->is_peak) {
    if (!crossing(start, way, at, &s, &t) || !(t > 0 && t < 1)) return;
    tl_add_scaled(t, at->way, p);
  }
  tl_minus(p, start, line);
  const double share = tl_dot(line, way) / tl_dot(way, way);
  if (!(share > 0 && share < 1)) return;
  for (int i = 0; i < 3; i++) line[i] = share * way[i] - line[i];
  const double far = tl_length(line), gap = far - b->one->radius;
  if (!(far > TL_SAME && gap < b->reach)) return;
  if (b->one->kind == TL_CYLINDER && -gap > (share < 0.5 ? share : 1 - share) * tl_length(way)) return; /* an end is nearer */
  for (int i = 0; i < 3; i++) line[i] /= far;
  if (!tl_supports(b->f, p, line)) return;
  tl_add_scaled(0.5 * gap, line, p);
  leave_out(b, p);
  tl_add_on_field(b, TL_SIDE, at->number, gap, line, p, 0);
}

/* Whether an edge in the ground is nearest to the ridge that it crosses, and not to what lies on its far side. Of the edge's
points x + k way the deepest one is as far below both sides of the ridge. off: from the ridge to x. */
int tl_is_near_ridge(const tl_field_body *b, const double *x, const double *way, double share, const double *off,
                     const tl_spot *ridge) {
  const int vertex = (int)(ridge->number / 4), ny = b->f->count[1];
  double left[3], right[3], tilt[3], y[3], deepest[3];
  tl_triangle under;
  tl_ridge_sides(b->f, vertex / ny, vertex % ny, (int)(ridge->number % 4), left, right);
  tl_minus(left, right, tilt);
  const double more = -tl_dot(off, tilt) / tl_dot(way, tilt);
  tl_copy3(x, y);
  tl_copy3(off, deepest);
  tl_add_scaled(more, way, y);
  tl_add_scaled(more, way, deepest);
  if (!(share + more >= 0 && share + more <= 1 && tl_below(b->f, y, &under))) return 0;
  return tl_dot(left, deepest) >= TL_FARTHER * tl_height_above(&under, y) - TL_SAME;
}

/* The edges of a hull that cross a ridge. */
static void on_edges(const tl_field_body *b, const tl_spot *ridge) {
  for (int k = 0; k < b->hull->edges; k++) {
    const int32_t *ends = b->hull->edge + 2 * k, *sides = b->hull->side + 2 * k;
    const double *u = b->solid->way + 3 * k;
    double way[3], x[3], p[3], apart[3], n[3], left[3], right[3], s, t;
    tl_copy3(b->solid->vertex + 3 * ends[0], x);
    tl_minus(b->solid->vertex + 3 * ends[1], x, way);
    if (!crossing(x, way, ridge, &s, &t) || !(s >= 0 && s <= 1 && t >= 0 && t <= 1)) continue;
    tl_cross(way, ridge->way, n);
    const double length = copysign(tl_length(n), n[2]);
    for (int i = 0; i < 3; i++) n[i] /= length;
    tl_copy3(ridge->start, p);
    tl_add_scaled(s, way, x);
    tl_add_scaled(t, ridge->way, p);
    tl_minus(x, p, apart);
    const double gap = tl_dot(n, apart);
    tl_cross(b->solid->normal + 3 * sides[0], n, left);
    tl_cross(b->solid->normal + 3 * sides[1], n, right);
    if (!(gap < b->reach && n[2] > TL_LEVEL && tl_dot(left, u) <= TL_LEVEL && tl_dot(right, u) >= -TL_LEVEL)) continue;
    if (tl_supports(b->f, p, n) && (gap > -TL_SAME || tl_is_near_ridge(b, x, way, s, apart, ridge)))
      tl_add_on_field(b, b->hull->vertices + k, ridge->number, gap, n, p, 0.5 * gap);
  }
}

/* The faces of a hull that a peak touches: the nearest ones, not those on the far side of the hull. */
static void on_faces(const tl_field_body *b, const tl_spot *peak) {
  const tl_hull *hull = b->hull;
  double away[3], x[3], most = -INFINITY;
  tl_minus(peak->start, b->solid->middle, away);
  tl_times_back(b->solid->turned, away, x);
  for (int k = 0; k < hull->faces; k++) most = tl_larger(most, tl_dot(hull->normal + 3 * k, x) - hull->height[k]);
  for (int k = 0; k < hull->faces; k++) {
    const double gap = tl_dot(hull->normal + 3 * k, x) - hull->height[k], *out = b->solid->normal + 3 * k;
    if (!(gap >= most - TL_SAME && gap < b->reach && out[2] < -TL_LEVEL)) continue;
    int side = hull->start[k];
    while (side < hull->start[k + 1] && tl_dot(hull->inward + 3 * side, x) - hull->depth[side] >= 0) side++;
    const double n[3] = {-out[0], -out[1], -out[2]};
    if (side == hull->start[k + 1] && tl_supports(b->f, peak->start, n))
      tl_add_on_field(b, hull->vertices + hull->edges + k, peak->number, gap, n, peak->start, 0.5 * gap);
  }
}

static void on_spot(const tl_field_body *b, const tl_spot *at) {
  if (!b->hull) on_line(b, at);
  else if (at->is_peak) on_faces(b, at);
  else on_edges(b, at);
  for (int end = 0; end < 2 && b->one->kind == TL_CYLINDER; end++) (at->is_peak ? tl_on_end : tl_on_crossings)(b, end, at);
}

/* The ridges and peaks near the body. */
static void on_spots(const tl_field_body *b) {
  const tl_field *f = b->f;
  const tl_cells near = tl_cells_over(f, b->low, b->high);
  for (int i = near.first[0]; i <= near.end[0]; i++)
    for (int k = near.first[1]; k <= near.end[1]; k++)
      for (int kind = 0; kind < 4; kind++) {
        const int64_t number = (int64_t)i * f->count[1] + k;
        if (!(f->marks[number] >> kind & 1)) continue;
        tl_spot at = {.number = 4 * number + kind, .is_peak = kind == 3};
        tl_field_corner(f, i, k, at.start);
        if (!at.is_peak) {
          tl_field_corner(f, i + (kind != 2), k + (kind != 1), at.way);
          tl_minus(at.way, at.start, at.way);
        }
        on_spot(b, &at);
      }
}

/* The points of a body over a field. */
static void detect(tl_scene *s, const tl_on_field *one, double reach) {
  tl_field_body b = {s, one, s->field + one->field, NULL, NULL, reach, {{0}}, {0}, {0}, s->count};
  const double near = one->radius + reach;
  const double *corners = b.ends[0];
  int count = one->kind == TL_BALL ? 1 : 2;
  if (one->kind == TL_HULL) {
    tl_place_solid(s, s->solid + one->solid);
    b.solid = s->solid + one->solid, b.hull = s->hull + b.solid->hull;
    corners = b.solid->vertex, count = b.hull->vertices;
  }
  for (int end = 0; end < count && !b.hull; end++)
    tl_at(s->turned + 9 * one->body, s->origin + 3 * one->body, one->end[end], b.ends[end]);
  for (int i = 0; i < 3; i++) {
    b.low[i] = INFINITY, b.high[i] = -INFINITY;
    for (int k = 0; k < count; k++) {
      b.low[i] = fmin(b.low[i], corners[3 * k + i] - near);
      b.high[i] = fmax(b.high[i], corners[3 * k + i] + near);
    }
  }
  if (!(b.low[2] <= b.f->top)) return;
  for (int k = 0; k < count && one->kind != TL_CYLINDER; k++) on_corner(&b, k, corners + 3 * k);
  for (int end = 0; end < 2 && one->kind == TL_CYLINDER; end++) tl_on_rim(&b, end);
  if (one->kind != TL_BALL) on_spots(&b);
}

void tl_detect_fields(tl_scene *s, double reach) {
  for (const tl_on_field *one = s->on_field; one < s->on_field + s->on_fields; one++) detect(s, one, reach);
}
