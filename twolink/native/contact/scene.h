/* Contact steps: what a scene is made of, what a step begins with and ends with, and what it works with.

The law is stated by contact/stepping.py, contact/step_law.py, contact/impulses.py and contact/positions.py, whose names the
fields have. Vectors have 3 numbers, matrices are by rows. Body 0 is the ground. */
#ifndef TWOLINK_CONTACT_H
#define TWOLINK_CONTACT_H
#include "../program.h"

#define TL_CLOSED 1e-10   /* m: what counts as no gap */
#define TL_TOUCHING 1e-6  /* m: points of two bodies that are so near move as one */
#define TL_STILL 1e-9     /* m/s: a slip that counts as none */
#define TL_EXACT 1e-11    /* m/s, and relative to the velocities: what the laws may be missed by */
#define TL_REGULAR 1e-11  /* what makes equations regular that are not independent */
enum { TL_HALVINGS = 10, TL_FACE = 4 };

/* Memory that is given back all at once. wanted: what was asked for when it did not suffice. */
typedef struct {
  char *memory;
  size_t size, used, wanted;
} tl_arena;

enum tl_joint_kind { TL_FREE, TL_SPHERICAL, TL_PLANAR, TL_REVOLUTE, TL_CONTINUOUS, TL_PRISMATIC, TL_JOINT_KINDS };

/* A body with the joint that carries it: first entries of q and of the velocity; the joint's frame in the parent's; centre of
mass and inertia about it along the body's axes; extent: as of `Detector`. */
typedef struct {
  int kind, parent, q, v, dofs, tree;
  double axis[3], rotation[9], origin[3], mass, centre[3], inertia[9], extent;
} tl_body;

/* Balls of a body over a plane of the world: numbers first to end of all balls; a sphere around them. */
typedef struct {
  int pair, body, first, end;
  double normal[3], height, centre[3], bound;
} tl_on_plane;

typedef struct {
  int pair, body, feature;
  double normal[3], height, point[3], axis[3], radius;
} tl_rim;

/* Heights over a grid (count), row by row along y; top: the highest; marks: of ridges and peaks; plane_of: of each triangle the
number of its plane. See geometry/fields.py. */
typedef struct {
  int count[2];
  double cell[2], origin[3], top, *height;
  int32_t *marks, *plane_of;
} tl_field;

enum tl_field_shape { TL_BALL, TL_CAPSULE, TL_CYLINDER, TL_HULL, TL_FIELD_SHAPES };

/* A body over a field: a solid, or the ends of an axis with a radius. */
typedef struct {
  int kind, pair, body, field, solid;
  double end[2][3], radius;
} tl_on_field;

enum tl_round_kind { TL_SEGMENTS, TL_BALL_BOX, TL_BALL_CYLINDER, TL_ROUND_KINDS };

/* A ball or a capsule and another shape. centre: of both; half: from the middles of segments to their ends; axes, edges: of
a box its axes by rows and its half edges; of a cylinder the first axis, then radius and half length. */
typedef struct {
  int kind, pair, first, second;
  double centre[2][3], radius[2], half[2][3], axes[9], edges[3], bound;
} tl_round;

/* A convex hull, see geometry/hulls.py. loops: the corners of all faces, which begin at starts. */
typedef struct {
  int vertices, faces, edges, corners;
  double *vertex, *normal, *height, *way, *inward, *depth;
  int32_t *edge, *side, *start, *loop;
} tl_hull;

/* A hull fixed to a body, and where it is: of one that was near since the last `tl_place`. */
typedef struct {
  int body, hull;
  double rotation[9], origin[3], bound, turned[9], middle[3];
  double *vertex, *normal, *height, *way;
  int64_t placed;
} tl_solid;

typedef struct {
  int pair, first, second;
} tl_hull_pair;

/* A stop or the dry friction of a joint: a point of the contact problem. */
typedef struct {
  int is_stop, entry, dof;
  double position, side;
} tl_joint_point;

/* A point at which bodies touch or are about to. dof: of a joint's point, else -1. */
typedef struct {
  int64_t key;
  int pair, first, second, dof;
  double gap, sign, normal[3], position[3];
} tl_point;

/* Points that the caller finds, of pairs that follow each other: normal, position (count, 3). overlap: the largest, m. */
typedef struct {
  int64_t count;
  const int64_t *keys;
  const int32_t *pair, *first, *second;
  const double *gap, *normal, *position;
  double overlap;
} tl_found;

/* Finds points with gaps below the reach, or the overlap, at poses of all bodies: rotations and origins. 0 if it does. */
typedef int (*tl_finder)(double reach, int wants_overlap, const double *turned, const double *origin, tl_found *out);

/* The rows of a point: its axes; J (3 x count) over degrees of freedom that fall, and Y, see rows.c, where they are needed. */
typedef struct {
  int count;
  int32_t *dof;
  double *j, *y, axes[9];
} tl_row;

/* See contact/steps.py. */
typedef struct {
  int count;
  int64_t *keys;
  double *forces, *change, overlap, unfollowed;
  uint8_t *stuck, *still;
} tl_memory;

/* Impulses of impacts in a step. */
typedef struct tl_blow {
  struct tl_blow *next;
  double late, *on_first, *on_joints;
  int count;
  int64_t *keys;
} tl_blow;

/* Counts of steps, halved ones, ones that bounce less, and by solver; the largest misses. */
typedef struct {
  double steps, halved, softened, newton, proximal, feasibility, complementarity;
} tl_record;

/* The end of a step. touches: whether there was a contact problem. places, on_first, slips (count, 3). joints: or NULL.
apart: of the step, the longest time between bounces of one pair in it. */
typedef struct {
  double h, *q, *v, *mean, *joints, *places, *on_first, *slips, feasibility, complementarity, residual, apart;
  tl_memory memory;
  int touches, solver, softened, count, rests;
  int64_t *keys;
  tl_blow *blows, *last_blow;
} tl_ended;

enum tl_solver { TL_NEWTON, TL_PROXIMAL };

/* A scene: its parts, which stay, and what its steps work with. buried: there are points that are not found. misses: whether what
touches within a step may be no point before. */
typedef struct {
  int bodies, nq, nv, numbers, pairs, balls, on_planes, rims, fields, on_fields, rounds, hulls, solids, hull_pairs, joint_points,
      loops, level;
  double gravity[3];
  tl_body *body;
  int32_t *dof_parent, *dof_body, *dof_depth, *feature;
  size_t *factor_at;
  double *armature, *viscosity, *ball[3], *radius;
  tl_on_plane *on_plane;
  tl_rim *rim;
  tl_field *field;
  tl_on_field *on_field;
  tl_round *round;
  int32_t *round_ends; /* the bodies of each again, which many that are far apart are read by */
  tl_hull *hull;
  tl_solid *solid;
  tl_hull_pair *hull_pair;
  tl_joint_point *joint_point;
  double *friction, *fixed, *restitution, *threshold, *thickness, *pressing;
  const tl_program *program, *loop_program;
  double *registers, *loop_registers, *input;
  /* rows of loops (loops, nv) with their gaps before them; what they ask for, see loops.c */
  double *loop_gaps, *loop_rows, *loop_open, *loop_wanted, *loop_missed, *loop_parts, *loop_basis, *loop_factor, *loop_change,
      *loop_closing;
  int32_t *loop_order;
  int loop_rank;
  /* at the configuration of the last tl_place: poses, axes of degrees of freedom, velocities, factors of the mass matrix */
  double *turned, *origin, *along, *about, *linear, *angular, *acceleration, *turning, *force, *moment, *composite, *factor,
      *inverse;
  int64_t placed;
  tl_point *points;
  int count, capacity, short_of_memory, buried, misses;
  double *heights;
  tl_finder find;
  tl_arena work, *ended, ends[2], words, blow_words;
  tl_record record;
  void *owned;
} tl_scene;

void *tl_take(tl_arena *arena, size_t count, size_t bytes);

void tl_place(tl_scene *s, const double *q);
void tl_velocities(tl_scene *s, const double *w);
double tl_fastest(tl_scene *s, const double *w);
void tl_minus_bias(tl_scene *s, const double *w, double *out);
void tl_factor(tl_scene *s, double h);
void tl_free_acceleration(tl_scene *s, double t, const double *q, const double *w, double h, const double *ahead,
                          const double *numbers, double *out);
void tl_moved(const tl_scene *s, const double *q, const double *change, double *out);
void tl_inward(const tl_scene *s, double *x);
void tl_outward(const tl_scene *s, double *x);
void tl_to_fixed_axes(const tl_scene *s, double *forces);
void tl_turning_forces(const tl_scene *s, const double *w, const double *forces, double *out);

double tl_loop_gap(tl_scene *s, const double *q);
void tl_loops_begin(tl_scene *s, const double *q, const double *w);
void tl_loops_at(tl_scene *s, const double *middle, const double *w);
void tl_keep_loops(tl_scene *s, double *free);
int tl_within_loops(tl_scene *s, tl_row *row);

/* What names a point: its pair, then the feature of the bodies that it is. */
static inline int64_t tl_key(int pair, int64_t feature) { return ((int64_t)pair << 38) + feature; }

void tl_add_point(tl_scene *s, const tl_point *point);
void tl_detect(tl_scene *s, double reach);
double tl_overlap(tl_scene *s, const double *q);
void tl_detect_fields(tl_scene *s, double reach);
void tl_rim_way(const double *n, const double *u, int way, double *out);
void tl_place_solid(const tl_scene *s, tl_solid *solid);
void tl_detect_rounds(tl_scene *s, double reach);
void tl_detect_hulls(tl_scene *s, double reach);
double tl_hull_overlap(tl_scene *s);
void tl_detect_others(tl_scene *s, double reach);
double tl_overlap_of_others(tl_scene *s);
void tl_joint_gaps(tl_scene *s, const double *q);
#endif
