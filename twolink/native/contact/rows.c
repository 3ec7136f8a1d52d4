/* Rows of points, J with U = J w, and Y with G = J M^-1 J^T = Y^T D^-1 Y.

With M = L^T D L it is Y = L^-T J^T, which has the rows of J's degrees of freedom and no more; what loops leave of it has all. */
#include "solver.h"
#include "vectors.h"

void *tl_take(tl_arena *arena, size_t count, size_t bytes) {
  const size_t most = SIZE_MAX / 4, size = bytes && count > most / bytes ? most : (count * bytes + 15) & ~(size_t)15;
  if (size > arena->size - arena->used) {
    if (arena->used + size > arena->wanted) arena->wanted = arena->used + size;
    return NULL;
  }
  void *out = arena->memory + arena->used;
  arena->used += size;
  return out;
}

/* Two tangents and the normal: `tangents` of geometry/gaps.py (Duff et al., J. Computer Graphics Techniques 6 (1), 2017). */
void tl_axes_of(const double *n, double *axes) {
  const double x = n[0], y = n[1], z = n[2], sign = z < 0.0 ? -1.0 : 1.0, a = -1.0 / (sign + z), b = x * y * a;
  axes[0] = 1.0 + sign * x * x * a, axes[1] = sign * b, axes[2] = -sign * x;
  axes[3] = b, axes[4] = sign + y * y * a, axes[5] = -y;
  tl_copy3(n, axes + 6);
}

/* The last degree of freedom that moves a body, -1 for the ground. */
static int last_of(const tl_scene *s, int body) {
  while (body && !s->body[body].dofs) body = s->body[body].parent;
  return body ? s->body[body].v + s->body[body].dofs - 1 : -1;
}

/* The velocity that a degree of freedom gives a point x of a body, added with a sign. */
static void add_velocity(const tl_scene *s, int d, const double *x, double sign, double *out) {
  double arm[3], v[3];
  tl_minus(x, s->origin + 3 * s->dof_body[d], arm);
  tl_cross(s->about + 3 * d, arm, v);
  for (int i = 0; i < 3; i++) out[i] += sign * (s->along[3 * d + i] + v[i]);
}

static int is_stop(const tl_scene *s, const tl_point *point) { return s->joint_point[point->pair - s->pairs].is_stop; }

/* Where the bodies of a point are at it: they move there as one, or each with its nearest point, see `Points.ends`. */
static void ends_of(const tl_point *point, double end[2][3]) {
  const double half = fabs(point->gap) < TL_TOUCHING ? 0.0 : 0.5 * point->gap;
  for (int i = 0; i < 3; i++)
    end[0][i] = point->position[i] + half * point->normal[i], end[1][i] = point->position[i] - half * point->normal[i];
}

/* U = J w (n, 3) of points with axes, from the velocities of their bodies. */
void tl_speeds(tl_scene *s, const tl_point *points, const tl_row *rows, int n, const double *w, double *out) {
  if (n && points->dof < 0) tl_velocities(s, w); /* points of bodies come first */
  for (int k = 0; k < n; k++, out += 3) {
    const tl_point *point = points + k;
    double end[2][3], arm[3], v[3];
    if (point->dof >= 0) {
      memset(out, 0, 3 * sizeof(double));
      out[is_stop(s, point) ? 2 : 0] = point->sign * w[point->dof];
      continue;
    }
    ends_of(point, end);
    const int a = 3 * point->first, b = 3 * point->second;
    tl_minus(s->linear + a, s->linear + b, v);
    tl_minus(end[0], s->origin + a, arm);
    tl_add_cross(s->angular + a, arm, v);
    tl_minus(s->origin + b, end[1], arm);
    tl_add_cross(s->angular + b, arm, v);
    tl_times(rows[k].axes, v, out);
  }
}

/* J of a joint's point, with the degrees of freedom that the joint hangs on, which Y has. */
static int rows_of_joint(tl_scene *s, const tl_point *point, tl_row *row) {
  const int count = row->count = s->dof_depth[point->dof] + 1;
  row->dof = tl_take(&s->work, (size_t)count, sizeof(int32_t));
  row->j = tl_take(&s->work, 3 * (size_t)count, sizeof(double));
  if (!row->dof || !row->j) return TL_NO_MEMORY;
  memset(row->j, 0, 3 * (size_t)count * sizeof(double));
  for (int k = 0, d = point->dof; k < count; k++, d = s->dof_parent[d]) row->dof[k] = d;
  row->j[is_stop(s, point) ? 2 : 0] = point->sign;
  return TL_FINE;
}

/* J of a point. */
static int rows_of(tl_scene *s, const tl_point *point, tl_row *row) {
  if (point->dof >= 0) return rows_of_joint(s, point, row);
  const int last[2] = {last_of(s, point->first), last_of(s, point->second)};
  const int most = (last[0] < 0 ? 0 : s->dof_depth[last[0]] + 1) + (last[1] < 0 ? 0 : s->dof_depth[last[1]] + 1);
  double end[2][3];
  ends_of(point, end);
  row->dof = tl_take(&s->work, (size_t)most, sizeof(int32_t));
  row->j = tl_take(&s->work, 3 * (size_t)most, sizeof(double));
  if (!row->dof || !row->j) return TL_NO_MEMORY;
  int count = 0;
  for (int a = last[0], b = last[1]; a >= 0 || b >= 0; count++) {
    const int d = a > b ? a : b, of_first = a == d, of_second = b == d;
    double v[3] = {0, 0, 0};
    if (of_first) add_velocity(s, d, end[0], 1, v), a = s->dof_parent[a];
    if (of_second) add_velocity(s, d, end[1], -1, v), b = s->dof_parent[b];
    row->dof[count] = d;
    tl_times(row->axes, v, row->j + 3 * count);
  }
  row->count = count;
  return TL_FINE;
}

/* J w (3). */
void tl_row_times(const tl_row *row, const double *w, double *out) {
  double a = 0, b = 0, c = 0;
  for (int k = 0; k < row->count; k++) {
    const double x = w[row->dof[k]], *j = row->j + 3 * k;
    a += j[0] * x, b += j[1] * x, c += j[2] * x;
  }
  out[0] = a, out[1] = b, out[2] = c;
}

/* out (nv) += values p, for values J^T or Y. */
void tl_add_row(const tl_row *row, const double *values, const double *p, double *out) {
  for (int k = 0; k < row->count; k++) out[row->dof[k]] += tl_dot(values + 3 * k, p);
}

/* J and Y = L^-T J^T of a point, if they are not there. */
int tl_need_row(tl_scene *s, const tl_point *point, tl_row *row) {
  if (row->y) return TL_FINE;
  const int code = rows_of(s, point, row);
  if (code) return code;
  double *y = tl_take(&s->work, 3 * (size_t)row->count, sizeof(double));
  if (!y) return TL_NO_MEMORY;
  if (row->count) memcpy(y, row->j, (size_t)row->count * 3 * sizeof(double));
  for (int k = 0; k < row->count; k++) {
    const int d = row->dof[k];
    const double *factor = s->factor + s->factor_at[d];
    int at = k + 1;
    for (int j = s->dof_parent[d]; j >= 0; j = s->dof_parent[j]) {
      while (row->dof[at] > j) at++; /* all that d hangs on is there */
      tl_add_scaled(-factor[s->dof_depth[j]], y + 3 * k, y + 3 * at);
    }
  }
  row->y = y;
  return s->loop_rank ? tl_within_loops(s, row) : TL_FINE;
}
