/* The impulses of a contact problem: the zeros of F(P) = P - proj(P - U / g) by Newton's method with a proximal term, and by
proximal points where it goes in circles. Statement, laws and sources: contact/impulses.py. */
#include "solver.h"
#include "vectors.h"

#define DAMPING 0.3   /* e, relative to the share of the velocities by which the laws are missed, and the largest */
#define NEARER 0.3    /* what a proximal point may miss, relative to the last one; and by how much e falls */
#define FLOOR 1e-10 /* the smallest e: what makes the equations regular where forces are not determined */
#define FIRST 1e-2    /* e of the proximal points: the first, the smallest, the largest */
#define LAST 1e-10
#define LARGEST 1.0
#define LOST 1e3 /* times what a point began with: what Newton's method misses after TRIED steps where it does not find it */
enum { NEWTON = 80, PATIENCE = 20, LEADING = 30, POINTS = 400, INNER = 10, TRIED = 4, FEW = 50 };

/* What the methods work with: u, z, F, and others of the same size (3n). */
typedef struct {
  int level;
  const tl_problem *problem;
  double *u, *z, *f, *best, *ahead, *anchor, *nearest, *step;
} workspace;

static int new_workspace(tl_scene *s, const tl_problem *problem, workspace *w) {
  const size_t n = (size_t)problem->g.points;
  double *x = tl_take(&s->work, 24 * n, sizeof(double));
  if (!x) return TL_NO_MEMORY;
  double **const parts[8] = {&w->u, &w->z, &w->f, &w->best, &w->ahead, &w->anchor, &w->nearest, &w->step};
  w->level = s->level, w->problem = problem;
  for (int k = 0; k < 8; k++) *parts[k] = x + 3 * n * (size_t)k;
  return TL_FINE;
}

/* F of three rows of joints: impulses less those within their bounds. */
static void miss_of_joints(const double *bounds, const double *p, const double *z, double *f) {
  for (int k = 0; k < 3; k++) f[k] = p[k] - tl_limited(z[k], bounds[2 * k], bounds[2 * k + 1]);
}

/* F of a contact. */
static void miss_of_contact(double mu, const double *p, const double *z, double *f) {
  const double normal = z[2] > 0.0 ? z[2] : 0.0, limit = mu * normal, length = sqrt(z[0] * z[0] + z[1] * z[1]);
  const double share = length > limit ? limit / length : 1.0;
  f[0] = p[0] - share * z[0], f[1] = p[1] - share * z[1], f[2] = p[2] - normal;
}

/* F, z = P - U / g and U + c; the residual |g F| relative to velocities that matter. damping, anchor: e and P_k of a proximal
point, or 0 and NULL. */
static double miss(workspace *w, const double *p, double damping, const double *anchor) {
  const tl_problem *q = w->problem;
  double worst = 0.0;
  tl_system_times(w->level, &q->g, p, w->u);
  for (int i = 0; i < q->g.points; i++) {
    double *u = w->u + 3 * i, *z = w->z + 3 * i, *f = w->f + 3 * i;
    const double *own = p + 3 * i, size = q->size[i];
    for (int k = 0; k < 3; k++) {
      u[k] += q->b[3 * i + k];
      if (anchor) u[k] += damping * size * (own[k] - anchor[3 * i + k]);
      z[k] = own[k] - u[k] / size;
    }
    if (q->mu[i] < 0.0) miss_of_joints(q->bounds + 6 * i, own, z, f);
    else miss_of_contact(q->mu[i], own, z, f);
    for (int k = 0; k < 3; k++) {
      const double one = fabs(f[k]) * size;
      if (!(one <= worst)) worst = one; /* so that NaN stays */
    }
  }
  return worst / q->scale;
}

/* How far the impulse p of a joint misses its law: a stop, or dry friction up to a limit. */
static void add_joint(const double *bounds, double size, double p, double u, tl_answer *out) {
  const int stops = isinf(bounds[1]);
  const double over = tl_larger(bounds[0] - p, p - bounds[1]) * size;
  out->feasibility = tl_larger(out->feasibility, stops ? tl_larger(-u, over) : over);
  out->complementarity = tl_larger(out->complementarity, fabs(stops ? p * u : bounds[1] * fabs(u) + p * u));
}

/* How far impulses miss the laws. */
static tl_answer answer(workspace *w, const double *p, int solver) {
  const tl_problem *q = w->problem;
  tl_answer out = {miss(w, p, 0.0, NULL), 0.0, 0.0, solver};
  for (int i = 0; i < q->g.points; i++) {
    const double *own = p + 3 * i, *u = w->u + 3 * i, limit = q->mu[i] * own[2];
    if (q->mu[i] < 0.0) {
      for (int k = 0; k < 3; k++) add_joint(q->bounds + 6 * i + 2 * k, q->size[i], own[k], u[k], &out);
      continue;
    }
    const double over = (sqrt(own[0] * own[0] + own[1] * own[1]) - limit) * q->size[i];
    const double slip = limit * sqrt(u[0] * u[0] + u[1] * u[1]) + own[0] * u[0] + own[1] * u[1];
    out.feasibility = tl_larger(tl_larger(-u[2], over), out.feasibility);
    out.complementarity = tl_larger(tl_larger(fabs(own[2] * u[2]), fabs(slip)), out.complementarity);
  }
  return out;
}

/* Whether an impulse is within its bounds, and changes with the velocities. */
static int is_inside(const double *bounds, double z) { return z > bounds[0] && z < bounds[1]; }

/* E^-1 and E^-1 C / g of a block, for C = dproj / dz and E = 1 - C + e C. Across a slip along x, C is s (1 - x x^T). */
static void equations_of(const tl_problem *q, int i, const double *z, double damping, double *inverse, double *coupling) {
  const double mu = q->mu[i], length = sqrt(z[0] * z[0] + z[1] * z[1]), limit = mu * z[2], g = q->size[i];
  const double full = 1.0 / damping;
  memset(inverse, 0, 9 * sizeof(double));
  memset(coupling, 0, 9 * sizeof(double));
  for (int k = 0; k < 3; k++) {
    const int presses = mu < 0.0 ? is_inside(q->bounds + 6 * i + 2 * k, z[k]) : z[2] > 0.0;
    inverse[4 * k] = presses ? full : 1.0, coupling[4 * k] = presses ? full / g : 0.0;
  }
  if (mu < 0.0 || !(z[2] > 0.0) || !(length > limit)) return;
  const double x[2] = {z[0] / length, z[1] / length}, s = limit / length, across = 1.0 / (1.0 - (1.0 - damping) * s);
  for (int k = 0; k < 2; k++) {
    for (int m = 0; m < 2; m++) {
      const double own = x[k] * x[m], other = (k == m) - own;
      inverse[3 * k + m] = own + across * other, coupling[3 * k + m] = s * across * other / g;
    }
    inverse[3 * k + 2] = (1.0 - damping) * full * mu * x[k], coupling[3 * k + 2] = full * mu * x[k] / g;
  }
}

/* P less (I - C + C (G / g + e))^-1 F; where nothing presses less F. 0 where the matrix is singular. */
static int newton_step(workspace *w, double *p, double damping) {
  const tl_system *g = &w->problem->g;
  for (int i = 0; i < g->points; i++)
    equations_of(w->problem, i, w->z + 3 * i, damping, g->inverse + 9 * i, g->coupling + 9 * i);
  if (!tl_factor_system(w->level, g)) return 0;
  memcpy(w->step, w->f, (size_t)g->points * 3 * sizeof(double));
  tl_solve_system(w->level, g, w->step);
  for (int i = 0; i < 3 * g->points; i++) p[i] -= w->step[i];
  return 1;
}

/* The best iterate of Newton's method on F, in place of the guess. */
static void newton(workspace *w, double *p) {
  const size_t bytes = (size_t)w->problem->g.points * 3 * sizeof(double);
  double best = INFINITY, mark = INFINITY;
  memcpy(w->best, p, bytes);
  for (int k = 0, since = 0; k <= NEWTON && since <= PATIENCE; k++, since++) {
    const double residual = miss(w, p, 0.0, NULL);
    if (!isfinite(residual)) break;
    if (residual < 0.5 * mark) mark = residual, since = 0;
    const int ends = residual <= 0.01 * TL_EXACT || (TL_EXACT >= best && best < 2.0 * residual);
    if (residual < best) {
      best = residual;
      memcpy(w->best, p, bytes);
    }
    const double share = residual * w->problem->scale / w->problem->fastest, most = DAMPING * share;
    if (ends || !newton_step(w, p, tl_limited(most, FLOOR, DAMPING))) break;
  }
  memcpy(p, w->best, bytes);
}

/* Steps of P - F / 3 with momentum, which is lost where it leads back. */
static void accelerated(workspace *w, double *p, int count) {
  const int n = 3 * w->problem->g.points;
  double inertia = 1.0;
  memcpy(w->ahead, p, (size_t)n * sizeof(double));
  for (int k = 0; k < count; k++) {
    double power = 0.0;
    miss(w, w->ahead, 0.0, NULL);
    for (int i = 0; i < n; i++) power += w->f[i] * (w->ahead[i] - w->f[i] / 3.0 - p[i]);
    if (power > 0.0) inertia = 1.0;
    const double more = 0.5 * (1.0 + sqrt(1.0 + 4.0 * inertia * inertia)), share = (inertia - 1.0) / more;
    for (int i = 0; i < n; i++) {
      const double after = w->ahead[i] - w->f[i] / 3.0, change = after - p[i];
      w->ahead[i] = after + share * change, p[i] = after;
    }
    inertia = more;
  }
}

/* The solution of the laws with U + e g (P - anchor) in place of U, in place of the anchor; 0 where Newton's method does not
find it. What obeys the laws as they are is taken at once. */
static int proximal_point(workspace *w, double *p, double damping, double small) {
  memcpy(w->anchor, p, (size_t)w->problem->g.points * 3 * sizeof(double));
  double lost = INFINITY;
  for (int k = 0; k <= INNER; k++) {
    if (miss(w, p, 0.0, NULL) <= TL_EXACT) return 1;
    const double residual = miss(w, p, damping, w->anchor);
    if (residual <= small) return 1;
    if (!k) lost = LOST * residual;
    if (!isfinite(residual) || (k >= TRIED && residual > lost) || !newton_step(w, p, damping)) break;
  }
  memcpy(p, w->anchor, (size_t)w->problem->g.points * 3 * sizeof(double));
  return 0;
}

/* The best of proximal points, whose e falls while Newton's method finds them. */
static void proximal(workspace *w, double *p) {
  const size_t bytes = (size_t)w->problem->g.points * 3 * sizeof(double);
  double best = INFINITY, damping = FIRST;
  memcpy(w->nearest, p, bytes);
  for (int k = 0; k < POINTS; k++) {
    const double residual = miss(w, p, 0.0, NULL);
    if (residual < best) {
      best = residual;
      memcpy(w->nearest, p, bytes);
    }
    if (!(residual > TL_EXACT)) break;
    if (proximal_point(w, p, damping, tl_larger(0.01 * TL_EXACT, NEARER * residual)))
      damping = tl_larger(NEARER * damping, LAST);
    else damping = 5.0 * damping < LARGEST ? 5.0 * damping : LARGEST;
  }
  memcpy(p, w->nearest, bytes);
}

/* size and velocities of a problem whose G and b are there. */
int tl_problem_sizes(tl_scene *s, tl_problem *q) {
  q->size = tl_take(&s->work, (size_t)q->g.points, sizeof(double));
  if (!q->size) return TL_NO_MEMORY;
  q->fastest = 1e-300;
  for (int i = 0; i < q->g.points; i++) {
    double own[3];
    tl_system_diagonal(&q->g, i, own);
    q->size[i] = tl_larger(tl_larger(own[0], own[1]), tl_larger(own[2], 1e-300));
    for (int k = 0; k < 3; k++) q->fastest = tl_larger(q->fastest, fabs(q->b[3 * i + k]));
  }
  q->scale = tl_larger(1.0, q->fastest);
  return TL_FINE;
}

/* The impulses of a problem from a guess, in its place; the best found where the laws are not reached. */
int tl_solve_impulses(tl_scene *s, const tl_problem *problem, double *p, tl_answer *out) {
  workspace w;
  const size_t mark = s->work.used;
  const int code = new_workspace(s, problem, &w);
  if (code) return code;
  if (problem->g.points > FEW) accelerated(&w, p, LEADING);
  newton(&w, p);
  *out = answer(&w, p, TL_NEWTON);
  if (!(out->residual <= TL_EXACT)) {
    accelerated(&w, p, LEADING);
    proximal(&w, p);
    *out = answer(&w, p, TL_PROXIMAL);
  }
  s->work.used = mark;
  return TL_FINE;
}
