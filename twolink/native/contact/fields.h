/* Surfaces of height fields, whose names are those of geometry/fields.py. */
#ifndef TWOLINK_CONTACT_FIELDS_H
#define TWOLINK_CONTACT_FIELDS_H
#include "scene.h"
#include "vectors.h"

#define TL_SAME 1e-9   /* m: points that are one, and heights of what lies on the surface */
#define TL_LEVEL 1e-6  /* rad: what counts as flat */
#define TL_FARTHER 4.0 /* times as deep as the surface below a point: what is deeper lies on the far side of a ridge */
enum { TL_SIDE = 2, TL_RIMS = 3, TL_CROSSINGS = 11 }; /* parts of round bodies behind their ends */

/* Cells first to end along x and y. */
typedef struct {
  int first[2], end[2];
} tl_cells;

typedef struct {
  double corner[3][3], normal[3];
  int number;
} tl_triangle;

/* A placed body over a field. ends: of its axis, of what is no hull; low, high: of the body with its reach; begin: the number
of its first point. */
typedef struct {
  tl_scene *s;
  const tl_on_field *one;
  const tl_field *f;
  const tl_solid *solid;
  const tl_hull *hull;
  double reach, ends[2][3], low[3], high[3];
  int begin;
} tl_field_body;

/* A ridge from its start along its way, or a peak; and its number. */
typedef struct {
  double start[3], way[3];
  int64_t number;
  int is_peak;
} tl_spot;

static inline int64_t tl_planes(const tl_field *f) { return 4 * (int64_t)f->count[0] * f->count[1]; }

tl_cells tl_cells_over(const tl_field *f, const double *low, const double *high);
tl_cells tl_cells_within(const tl_field *f, const double *x, double near);
void tl_field_corner(const tl_field *f, int i, int k, double *out);
tl_triangle tl_triangle_of(const tl_field *f, int i, int k, int half);
void tl_ridge_sides(const tl_field *f, int i, int k, int kind, double *left, double *right);
int tl_below(const tl_field *f, const double *x, tl_triangle *out);
double tl_height_above(const tl_triangle *one, const double *x);
void tl_nearest_of_triangle(const tl_triangle *one, const double *x, double *out);
int tl_supports(const tl_field *f, const double *p, const double *n);

void tl_add_on_field(const tl_field_body *b, int part, int64_t number, double gap, const double *n, const double *x,
                     double far);
int tl_same_way(const double *n, const double *m);
void tl_each_once(tl_scene *s, int begin);
int64_t tl_plane_number(const tl_field *f, const tl_triangle *one, int is_edge);
int tl_is_near_ridge(const tl_field_body *b, const double *x, const double *way, double share, const double *off,
                     const tl_spot *ridge);
void tl_on_rim(const tl_field_body *b, int end);
void tl_on_end(const tl_field_body *b, int end, const tl_spot *peak);
void tl_on_crossings(const tl_field_body *b, int end, const tl_spot *ridge);
#endif
