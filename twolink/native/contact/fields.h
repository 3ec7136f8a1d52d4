/* Surfaces of height fields, whose names are those of geometry/fields.py. */
#ifndef TWOLINK_CONTACT_FIELDS_H
#define TWOLINK_CONTACT_FIELDS_H
#include "scene.h"
#include "vectors.h"

#define TL_SAME 1e-9  /* m: points that are one, and heights of what lies on the surface */
#define TL_LEVEL 1e-6 /* rad: what counts as flat */

/* Cells first to end along x and y. */
typedef struct {
  int first[2], end[2];
} tl_cells;

typedef struct {
  double corner[3][3], normal[3];
  int number;
} tl_triangle;

tl_cells tl_cells_over(const tl_field *f, const double *low, const double *high);
tl_cells tl_cells_within(const tl_field *f, const double *x, double near);
void tl_field_corner(const tl_field *f, int i, int k, double *out);
tl_triangle tl_triangle_of(const tl_field *f, int i, int k, int half);
void tl_ridge_sides(const tl_field *f, int i, int k, int kind, double *left, double *right);
int tl_below(const tl_field *f, const double *x, tl_triangle *out);
double tl_height_above(const tl_triangle *one, const double *x);
void tl_nearest_of_triangle(const tl_triangle *one, const double *x, double *out);
int tl_supports(const tl_field *f, const double *p, const double *n);
#endif
