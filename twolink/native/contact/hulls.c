/* Convex hulls of boxes and meshes against each other: how far they are apart, and where they touch. The formulas and their
sources are those of geometry/hulls.py, and so are the names of points, as numbers. */
#include "scene.h"
#include "vectors.h"

#include <stdlib.h>

#define PARALLEL 1e-6   /* the sine between edges below which they count as parallel */
#define FACE_FIRST 1e-6 /* m by which edges must be farther apart, so that faces that lie on each other keep their points */
#define WITHIN 1e-9     /* m: a point so far outside of a prism is within */
enum { MOST_CORNERS = 256, OF_SECOND = 1, CROSSING = 2 };

/* Two hulls that are placed. edges: how many both have. */
typedef struct {
  tl_scene *s;
  tl_solid *solid[2];
  const tl_hull *hull[2];
  int pair, edges;
} both_hulls;

/* A corner of a polygon, and the number of the edge of a hull that the side after it lies on. */
typedef struct {
  double x[3];
  int side;
} corner;

/* The face or the edges along whose normal hulls are farthest apart. The normal is from the second hull to the first. */
typedef struct {
  double gap, normal[3];
  int second, face, edge[2];
} separation;

static void find_pose(const tl_scene *s, tl_solid *solid) {
  tl_product(s->turned + 9 * solid->body, solid->rotation, solid->turned);
  tl_at(s->turned + 9 * solid->body, s->origin + 3 * solid->body, solid->origin, solid->middle);
}

/* Where a hull is: its corners, normals with heights, and edges, along the world's axes. */
void tl_place_solid(const tl_scene *s, tl_solid *solid) {
  const tl_hull *hull = s->hull + solid->hull;
  if (solid->placed == s->placed) return;
  solid->placed = s->placed;
  find_pose(s, solid);
  const double *r = solid->turned;
  for (int i = 0; i < hull->vertices; i++) tl_at(r, solid->middle, hull->vertex + 3 * i, solid->vertex + 3 * i);
  for (int i = 0; i < hull->edges; i++) tl_times(r, hull->way + 3 * i, solid->way + 3 * i);
  for (int i = 0; i < hull->faces; i++) {
    tl_times(r, hull->normal + 3 * i, solid->normal + 3 * i);
    solid->height[i] = hull->height[i] + tl_dot(solid->normal + 3 * i, solid->middle);
  }
}

/* The face of a hull over which all of the other one is highest: that height. */
static double over_faces(const both_hulls *h, int base, int *face) {
  const tl_solid *own = h->solid[base], *other = h->solid[!base];
  double most = -INFINITY;
  for (int f = 0; f < h->hull[base]->faces; f++) {
    double low = INFINITY;
    for (int i = 0; i < h->hull[!base]->vertices; i++) {
      const double height = tl_dot(own->normal + 3 * f, other->vertex + 3 * i);
      if (height < low) low = height;
    }
    if (low - own->height[f] > most) most = low - own->height[f], *face = f;
  }
  return most;
}

/* The separation along normals of faces. second: by so much more the first hull's must be apart, m. */
static separation by_faces(const both_hulls *h, double second) {
  separation out = {.edge = {-1, -1}};
  int first = 0, other = 0;
  const double a = over_faces(h, 0, &first), b = over_faces(h, 1, &other);
  out.second = !(a > b + second), out.face = out.second ? other : first, out.gap = out.second ? b : a;
  tl_copy3(h->solid[out.second]->normal + 3 * out.face, out.normal);
  if (!out.second)
    for (int i = 0; i < 3; i++) out.normal[i] = -out.normal[i];
  return out;
}

static double larger_of(double a, double b) { return a > b ? a : b; }
static double smaller_of(double a, double b) { return a < b ? a : b; }

/* The separation across edges, where it is more than the least, m; else 0. Only edges count between which both bodies lie on
different sides of the plane across n. */
static int by_edges(const both_hulls *h, double least, separation *out) {
  const tl_solid *a = h->solid[0], *b = h->solid[1];
  int found = 0;
  for (int i = 0; i < h->hull[0]->edges; i++) {
    const double *u = a->way + 3 * i, *left = a->normal + 3 * h->hull[0]->side[2 * i];
    const double *right = a->normal + 3 * h->hull[0]->side[2 * i + 1], *p = a->vertex + 3 * h->hull[0]->edge[2 * i];
    for (int k = 0; k < h->hull[1]->edges; k++) {
      const double *w = b->way + 3 * k;
      const double s1 = tl_dot(left, w), s2 = -tl_dot(right, w);
      const double s3 = tl_dot(u, b->normal + 3 * h->hull[1]->side[2 * k]);
      const double s4 = -tl_dot(u, b->normal + 3 * h->hull[1]->side[2 * k + 1]);
      const double most = larger_of(larger_of(s1, s2), larger_of(s3, s4));
      const double smallest = smaller_of(smaller_of(s1, s2), smaller_of(s3, s4));
      if (!(smaller_of(most, -smallest) <= 0.0)) continue;
      const double side = most <= -smallest ? 1.0 : -1.0;
      double across[3], apart[3];
      tl_cross(u, w, across);
      const double length = tl_length(across);
      if (!(length > PARALLEL)) continue;
      tl_minus(p, b->vertex + 3 * h->hull[1]->edge[2 * k], apart);
      const double gap = side * tl_dot(across, apart) / length;
      if (!(gap > least)) continue;
      found = 1, least = gap, out->gap = gap, out->edge[0] = i, out->edge[1] = k;
      for (int m = 0; m < 3; m++) out->normal[m] = side / length * across[m];
    }
  }
  return found;
}

/* The number of the edge between two corners of a hull, those of the second behind those of the first. */
static int edge_between(const both_hulls *h, int second, int i, int k) {
  const tl_hull *hull = h->hull[second];
  const int low = i < k ? i : k, high = i < k ? k : i;
  for (int e = 0; e < hull->edges; e++)
    if (hull->edge[2 * e] == low && hull->edge[2 * e + 1] == high) return e + (second ? h->hull[0]->edges : 0);
  return 0;
}

/* Keep a point by its kind and the two edges that it lies between. */
static void add(const both_hulls *h, int kind, const int *edges, double gap, const double *normal, const double *middle) {
  tl_point point = {.pair = h->pair, .first = h->solid[0]->body, .second = h->solid[1]->body, .dof = -1, .gap = gap};
  const int64_t all = h->edges;
  point.key = tl_key(h->pair, (kind * all + edges[0]) * all + edges[1]);
  tl_copy3(normal, point.normal);
  tl_copy3(middle, point.position);
  tl_add_point(h->s, &point);
}

/* The nearest points of two edges: p + s u - q - t w = gap n; within the edges, and within reach of each other. */
static void crossing(const both_hulls *h, const separation *apart, double reach) {
  const double *x[2], *n = apart->normal;
  double u[2][3], r[3], at[2][3];
  for (int k = 0; k < 2; k++) {
    const int32_t *ends = h->hull[k]->edge + 2 * apart->edge[k];
    x[k] = h->solid[k]->vertex + 3 * ends[0];
    tl_minus(h->solid[k]->vertex + 3 * ends[1], x[k], u[k]);
  }
  double un[3], wn[3];
  tl_minus(x[1], x[0], r);
  tl_cross(u[0], n, un);
  tl_cross(u[1], n, wn);
  const double s = tl_dot(r, wn) / tl_dot(u[0], wn), t = -tl_dot(r, un) / tl_dot(u[1], un);
  const double share[2] = {tl_limited(s, 0, 1), tl_limited(t, 0, 1)};
  for (int k = 0; k < 2; k++) {
    tl_copy3(x[k], at[k]);
    tl_add_scaled(share[k], u[k], at[k]);
  }
  tl_minus(at[0], at[1], r);
  if (!(tl_dot(r, r) < reach * reach) && !(apart->gap < 0.0)) return;
  const int names[2] = {apart->edge[0], apart->edge[1] + h->hull[0]->edges};
  for (int i = 0; i < 3; i++) r[i] = 0.5 * (at[0][i] + at[1][i]);
  add(h, CROSSING, names, apart->gap, n, r);
}

/* The face of a hull that looks most against a normal, of those at its lowest corner. */
static int face_at_lowest(const tl_hull *hull, const tl_solid *solid, const double *normal) {
  int lowest = hull->vertices, face = hull->faces;
  double low = INFINITY;
  for (int k = 0; k < 2 * hull->edges; k++) { /* vertices without edges are no corners */
    const int i = hull->edge[k];
    const double height = tl_dot(solid->vertex + 3 * i, normal);
    if (height < low || (height == low && i < lowest)) low = height, lowest = i;
  }
  low = INFINITY;
  for (int e = 0; e < hull->edges; e++) {
    if (hull->edge[2 * e] != lowest && hull->edge[2 * e + 1] != lowest) continue;
    for (int m = 0; m < 2; m++) {
      const int f = hull->side[2 * e + m];
      const double height = tl_dot(solid->normal + 3 * f, normal);
      if (height < low || (height == low && f < face)) low = height, face = f;
    }
  }
  return face < hull->faces ? face : 0; /* of what is not finite */
}

/* The part of a polygon with depths that are not negative. side: the number of the side that this makes. Returns its size. */
static int cut(corner *x, int count, const double *depths, int side) {
  corner kept[MOST_CORNERS];
  int size = 0;
  for (int k = 0; k < count && size < MOST_CORNERS - 1; k++) {
    const int m = k + 1 < count ? k + 1 : 0, inside = depths[k] >= 0.0;
    if (inside) kept[size++] = x[k];
    if (inside != (depths[m] >= 0.0)) {
      const double share = depths[k] / (depths[k] - depths[m]);
      for (int i = 0; i < 3; i++) kept[size].x[i] = x[k].x[i] + (x[m].x[i] - x[k].x[i]) * share;
      kept[size++].side = inside ? side : x[k].side;
    }
  }
  memcpy(x, kept, (size_t)size * sizeof(corner));
  return size;
}

/* The corners of the other hull's face within the prism over a face of the base; how many there are. */
static int over_face(const both_hulls *h, int base, int face, corner *x) {
  const tl_hull *own = h->hull[base], *other = h->hull[!base];
  const double *normal = h->solid[base]->normal + 3 * face;
  const int facing = face_at_lowest(other, h->solid[!base], normal);
  const int32_t *corners = other->loop + other->start[facing], *loop = own->loop + own->start[face];
  const int sides = own->start[face + 1] - own->start[face];
  int count = other->start[facing + 1] - other->start[facing];
  double depths[MOST_CORNERS];
  if (count > MOST_CORNERS / 2) return 0;
  for (int k = 0; k < count; k++) {
    tl_copy3(h->solid[!base]->vertex + 3 * corners[k], x[k].x);
    x[k].side = edge_between(h, !base, corners[k], corners[k + 1 < count ? k + 1 : 0]);
  }
  for (int side = 0; side < sides && count; side++) {
    const int at = own->start[face] + side;
    double inward[3];
    int outside = 0;
    tl_times(h->solid[base]->turned, own->inward + 3 * at, inward);
    const double depth = own->depth[at] + tl_dot(inward, h->solid[base]->middle) - WITHIN;
    for (int k = 0; k < count; k++) {
      depths[k] = tl_dot(x[k].x, inward) - depth;
      outside |= depths[k] < 0.0;
    }
    if (outside) count = cut(x, count, depths, edge_between(h, base, loop[side], loop[side + 1 < sides ? side + 1 : 0]));
  }
  return count;
}

/* The points of a pair with gaps below the reach. Where edges cross, corners over the best face count too. */
static void touching(const both_hulls *h, double reach) {
  const separation face = by_faces(h, FACE_FIRST);
  separation edges = face;
  if (face.gap > reach) return;
  const int crosses = by_edges(h, face.gap + FACE_FIRST, &edges);
  if (edges.gap > reach) return;
  const int first = h->s->count, base = face.second;
  if (crosses) crossing(h, &edges, reach);
  const int crossed = h->s->count > first;
  corner x[MOST_CORNERS];
  const int count = over_face(h, base, face.face, x);
  const double *normal = h->solid[base]->normal + 3 * face.face;
  for (int k = 0; k < count; k++) {
    const int names[2] = {x[k ? k - 1 : count - 1].side, x[k].side};
    const double gap = tl_dot(x[k].x, normal) - h->solid[base]->height[face.face];
    if (!(gap < reach)) continue;
    const int e = edges.edge[0], f = edges.edge[1] + h->hull[0]->edges;
    if (crossed && ((names[0] == e && names[1] == f) || (names[0] == f && names[1] == e))) continue;
    double middle[3];
    tl_copy3(x[k].x, middle);
    tl_add_scaled(-0.5 * gap, normal, middle);
    add(h, base ? OF_SECOND : 0, names, gap, face.normal, middle);
  }
}

/* The hulls of a pair, placed; 0 where their bounding spheres are farther apart than the reach. */
static int near(tl_scene *s, const tl_hull_pair *pair, double reach, both_hulls *out) {
  tl_solid *a = s->solid + pair->first, *b = s->solid + pair->second;
  double apart[3];
  tl_minus(a->middle, b->middle, apart);
  const double limit = a->bound + b->bound + reach;
  if (!(tl_dot(apart, apart) < limit * limit)) return 0;
  tl_place_solid(s, a);
  tl_place_solid(s, b);
  const tl_hull *first = s->hull + a->hull, *second = s->hull + b->hull;
  *out = (both_hulls){s, {a, b}, {first, second}, pair->pair, first->edges + second->edges};
  return 1;
}

/* The poses of all hulls. */
static void place_solids(tl_scene *s) {
  for (tl_solid *one = s->solid; one < s->solid + s->solids; one++)
    if (one->placed != s->placed) find_pose(s, one);
}

void tl_detect_hulls(tl_scene *s, double reach) {
  both_hulls h;
  place_solids(s);
  for (const tl_hull_pair *pair = s->hull_pair; pair < s->hull_pair + s->hull_pairs; pair++)
    if (near(s, pair, reach, &h)) touching(&h, reach);
}

/* The largest overlap of two hulls, m. */
double tl_hull_overlap(tl_scene *s) {
  double most = 0.0;
  both_hulls h;
  place_solids(s);
  for (const tl_hull_pair *pair = s->hull_pair; pair < s->hull_pair + s->hull_pairs; pair++) {
    if (!near(s, pair, 0.0, &h)) continue;
    separation one = by_faces(&h, 0.0);
    if (one.gap >= -most) continue;
    by_edges(&h, one.gap, &one);
    most = tl_larger(most, -one.gap);
  }
  return most;
}
