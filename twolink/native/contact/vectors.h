/* Vectors of 3 numbers and matrices (3 x 3) by rows. */
#ifndef TWOLINK_CONTACT_VECTORS_H
#define TWOLINK_CONTACT_VECTORS_H
#include <math.h>
#include <string.h>

static inline double tl_dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline double tl_length(const double *a) { return sqrt(tl_dot(a, a)); }

/* out += a x b; out is neither. */
static inline void tl_add_cross(const double *a, const double *b, double *out) {
  out[0] += a[1] * b[2] - a[2] * b[1];
  out[1] += a[2] * b[0] - a[0] * b[2];
  out[2] += a[0] * b[1] - a[1] * b[0];
}

static inline void tl_cross(const double *a, const double *b, double *out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void tl_copy3(const double *a, double *out) { out[0] = a[0], out[1] = a[1], out[2] = a[2]; }

static inline void tl_minus(const double *a, const double *b, double *out) {
  for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}

/* out += k a */
static inline void tl_add_scaled(double k, const double *a, double *out) {
  for (int i = 0; i < 3; i++) out[i] += k * a[i];
}

/* R x */
static inline void tl_times(const double *r, const double *x, double *out) {
  for (int i = 0; i < 3; i++) out[i] = r[3 * i] * x[0] + r[3 * i + 1] * x[1] + r[3 * i + 2] * x[2];
}

/* R^T x */
static inline void tl_times_back(const double *r, const double *x, double *out) {
  for (int i = 0; i < 3; i++) out[i] = r[i] * x[0] + r[3 + i] * x[1] + r[6 + i] * x[2];
}

/* A B */
static inline void tl_product(const double *a, const double *b, double *out) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* A point of a body in the world: R x + p. */
static inline void tl_at(const double *r, const double *p, const double *x, double *out) {
  for (int i = 0; i < 3; i++) out[i] = r[3 * i] * x[0] + r[3 * i + 1] * x[1] + r[3 * i + 2] * x[2] + p[i];
}

static inline double tl_larger(double a, double b) { return a > b ? a : b; }

static inline double tl_limited(double x, double low, double high) { return x < low ? low : x > high ? high : x; }
#endif
