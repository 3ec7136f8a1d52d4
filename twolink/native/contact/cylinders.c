/* Points at which the rims and ends of cylinders touch height fields: geometry/on_fields.py is the statement. */
#include "fields.h"

/* The direction out of an end of a cylinder. */
static void outward(const tl_field_body *b, int end, double *out) {
  tl_minus(b->ends[end], b->ends[!end], out);
  const double length = tl_length(out);
  for (int i = 0; i < 3; i++) out[i] /= length;
}

/* The points of a rim that touch triangles: for each of their planes the lowest, the highest, and those between. */
void tl_on_rim(const tl_field_body *b, int end) {
  double out[3], across[3], x[3], away[3];
  outward(b, end, out);
  const tl_cells at = tl_cells_within(b->f, b->ends[end], b->one->radius + b->reach);
  for (int way = 0; way < 4; way++) {
    const int begin = b->s->count, part = TL_RIMS + 4 * end + way;
    for (int i = at.first[0]; i < at.end[0]; i++)
      for (int k = at.first[1]; k < at.end[1]; k++)
        for (int half = 0; half < 2; half++) {
          const tl_triangle here = tl_triangle_of(b->f, i, k, half);
          tl_triangle under;
          tl_rim_way(here.normal, out, way, across);
          tl_copy3(b->ends[end], x);
          tl_add_scaled(b->one->radius, across, x);
          if (!tl_below(b->f, x, &under) || !tl_same_way(under.normal, here.normal)) continue;
          tl_minus(x, under.corner[0], away);
          const double gap = tl_dot(here.normal, away);
          if (gap < b->reach) tl_add_on_field(b, part, tl_plane_number(b->f, &under, 0), gap, here.normal, x, -0.5 * gap);
        }
    tl_each_once(b->s, begin);
  }
}

/* A peak below the disc at an end. */
void tl_on_end(const tl_field_body *b, int end, const tl_spot *peak) {
  double out[3], away[3], across[3];
  outward(b, end, out);
  tl_minus(peak->start, b->ends[end], away);
  const double over = tl_dot(away, out); /* below 0: in the disc's way */
  tl_copy3(away, across);
  tl_add_scaled(-over, out, across);
  const double beside = tl_length(across), radius = b->one->radius, n[3] = {-out[0], -out[1], -out[2]};
  if (out[2] > -TL_LEVEL || !(beside < radius && over < b->reach && over > beside - radius)) return;
  if (tl_supports(b->f, peak->start, n)) tl_add_on_field(b, end, peak->number, over, n, peak->start, 0.5 * over);
}

/* The crossings of a ridge and a rim, as seen along the axis. */
void tl_on_crossings(const tl_field_body *b, int end, const tl_spot *ridge) {
  const double radius = b->one->radius;
  double out[3], start[3], edge[3], inside[3];
  tl_minus(b->ends[end], b->ends[!end], out);
  const double length = tl_length(out);
  for (int i = 0; i < 3; i++) out[i] /= length;
  tl_minus(ridge->start, b->ends[end], start);
  const double begin = tl_dot(start, out);
  tl_add_scaled(-tl_dot(start, out), out, start);
  tl_copy3(ridge->way, edge);
  tl_add_scaled(-tl_dot(edge, out), out, edge);
  const double a = tl_dot(edge, edge), c = tl_dot(start, edge), inner = c * c - a * (tl_dot(start, start) - radius * radius);
  if (!(inner > 0 && a > TL_SAME * TL_SAME)) return;
  tl_copy3(start, inside);
  const double deepest = tl_limited(-c / a, 0, 1); /* of the ridge, below the side */
  tl_add_scaled(deepest, edge, inside);
  const double beside = TL_FARTHER * (radius - tl_length(inside)) + TL_SAME, deep = -begin - deepest * tl_dot(ridge->way, out);
  for (int root = 0; root < 2; root++) {
    const double share = (-c + (root ? 1 : -1) * sqrt(inner)) / a;
    double radial[3], tangent[3], n[3], x[3], p[3], apart[3];
    for (int i = 0; i < 3; i++) radial[i] = (start[i] + share * edge[i]) / radius;
    tl_cross(out, radial, tangent);
    tl_cross(tangent, ridge->way, n);
    const double size = tl_length(n), scale = copysign(1 / size, n[2]);
    if (!(share >= 0 && share <= 1 && size > TL_LEVEL * tl_length(ridge->way))) continue;
    for (int i = 0; i < 3; i++) n[i] *= scale;
    tl_copy3(b->ends[end], x);
    tl_add_scaled(radius, radial, x);
    tl_copy3(ridge->start, p);
    tl_add_scaled(share, ridge->way, p);
    tl_minus(x, p, apart);
    const double gap = tl_dot(n, apart), own = tl_dot(apart, out); /* below the end */
    if (!(gap < b->reach && own < length && (own < beside || deep < beside))) continue; /* the side has the smaller overlap */
    if (!(-tl_dot(n, out) >= -TL_LEVEL && -tl_dot(n, radial) >= -TL_LEVEL) || !tl_supports(b->f, p, n)) continue;
    for (int i = 0; i < 3; i++) tangent[i] *= radius;
    if (!(gap > -TL_SAME) && !tl_is_near_ridge(b, x, tangent, 0.5, apart, ridge)) continue;
    for (int i = 0; i < 3; i++) p[i] = 0.5 * (x[i] + p[i]);
    tl_add_on_field(b, TL_CROSSINGS + 2 * end + root, ridge->number, gap, n, p, 0);
  }
}
