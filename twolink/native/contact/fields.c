/* Surfaces of height fields: geometry/fields.py is the statement. Source: Ericson, Real-Time Collision Detection, 2005, section
5.1.5. */
#include "fields.h"

/* A number of cells from none to all, of what need not be finite. */
static int counted(double x, int most) { return x > 0 ? (x < most ? (int)x : most) : 0; }

tl_cells tl_cells_over(const tl_field *f, const double *low, const double *high) {
  tl_cells out;
  for (int i = 0; i < 2; i++) {
    const int most = f->count[i] - 1;
    out.first[i] = counted(floor((low[i] - f->origin[i]) / f->cell[i]), most);
    out.end[i] = counted(floor((high[i] - f->origin[i]) / f->cell[i]) + 1, most);
  }
  return out;
}

tl_cells tl_cells_within(const tl_field *f, const double *x, double near) {
  const double low[2] = {x[0] - near, x[1] - near}, high[2] = {x[0] + near, x[1] + near};
  return tl_cells_over(f, low, high);
}

void tl_field_corner(const tl_field *f, int i, int k, double *out) {
  out[0] = i * f->cell[0] + f->origin[0], out[1] = k * f->cell[1] + f->origin[1];
  out[2] = f->height[(size_t)i * (size_t)f->count[1] + (size_t)k] + f->origin[2];
}

/* The triangle of a cell on the side of low y (0) or of low x (1). */
tl_triangle tl_triangle_of(const tl_field *f, int i, int k, int half) {
  tl_triangle out = {.number = 2 * (i * (f->count[1] - 1) + k) + half};
  double along[3], beside[3];
  tl_field_corner(f, i, k, out.corner[0]);
  tl_field_corner(f, i + 1, half ? k + 1 : k, out.corner[1]);
  tl_field_corner(f, half ? i : i + 1, k + 1, out.corner[2]);
  tl_minus(out.corner[1], out.corner[0], along);
  tl_minus(out.corner[2], out.corner[0], beside);
  tl_cross(along, beside, out.normal);
  const double length = tl_length(out.normal);
  for (int c = 0; c < 3; c++) out.normal[c] /= length;
  return out;
}

/* The normal of a triangle; beyond the grid, outward across its border. */
static void side_of(const tl_field *f, int i, int k, int half, double *out) {
  const double outward[3] = {(i + 1 >= f->count[0]) - (i < 0), (k + 1 >= f->count[1]) - (k < 0), 0};
  const int beyond = outward[0] != 0 || outward[1] != 0;
  const tl_triangle one = tl_triangle_of(f, beyond ? 0 : i, beyond ? 0 : k, half);
  tl_copy3(beyond ? outward : one.normal, out);
}

/* The normals on the left and on the right of the ridge that begins at a corner: a diagonal, one along x, one along y. */
void tl_ridge_sides(const tl_field *f, int i, int k, int kind, double *left, double *right) {
  side_of(f, kind == 2 ? i - 1 : i, k, kind == 0, left);
  side_of(f, i, kind == 1 ? k - 1 : k, kind != 0, right);
}

/* Whether a triangle lies below a point, and which. */
int tl_below(const tl_field *f, const double *x, tl_triangle *out) {
  int number[2];
  double at[2];
  for (int i = 0; i < 2; i++) {
    at[i] = (x[i] - f->origin[i]) / f->cell[i];
    if (!(at[i] >= 0 && at[i] <= f->count[i] - 1)) return 0;
    number[i] = counted(at[i], f->count[i] - 2);
  }
  *out = tl_triangle_of(f, number[0], number[1], !(at[0] - number[0] >= at[1] - number[1]));
  return 1;
}

/* The height of a point above the plane of a triangle. */
double tl_height_above(const tl_triangle *one, const double *x) {
  double away[3];
  tl_minus(x, one->corner[0], away);
  return tl_dot(one->normal, away);
}

/* The point of a triangle that is nearest to another one. */
void tl_nearest_of_triangle(const tl_triangle *one, const double *x, double *out) {
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
  tl_add_scaled(-tl_height_above(one, x), one->normal, out);
}

/* Whether the triangles at a point of the surface lie below the plane across n. */
int tl_supports(const tl_field *f, const double *p, const double *n) {
  const tl_cells at = tl_cells_within(f, p, TL_SAME);
  for (int i = at.first[0]; i < at.end[0]; i++)
    for (int k = at.first[1]; k < at.end[1]; k++)
      for (int half = 0; half < 2; half++) {
        const tl_triangle one = tl_triangle_of(f, i, k, half);
        double off[3], way[3];
        tl_nearest_of_triangle(&one, p, way);
        tl_minus(way, p, off);
        if (!(tl_dot(off, off) <= TL_SAME * TL_SAME)) continue;
        for (int j = 0; j < 3; j++) {
          tl_minus(one.corner[j], p, way);
          if (!(tl_dot(way, n) <= TL_LEVEL * tl_length(way) + TL_SAME * TL_SAME)) return 0;
        }
      }
  return 1;
}
