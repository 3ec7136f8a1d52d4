/* Programs and methods: what the machine runs.

A program is a traced formula as a list of instructions on registers. A register holds one number a column, for W columns
side by side. Registers 0, 1, ... are the inputs; constants that an instruction cannot take as a scalar follow. The code
consists of quads of 16-bit numbers. A run is a head [operation, count, 0, 0] and then `count` instructions of one, two or
three quads, all of this operation, so that one dispatch serves them all. An instruction is [result, operands ...]. */
#ifndef TWOLINK_PROGRAM_H
#define TWOLINK_PROGRAM_H
#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define TL_API __declspec(dllexport)
#else
#define TL_API __attribute__((visibility("default")))
#endif

/* The operations, in the order of `assembly.OPERATIONS`. K: the second operand is a scalar constant.
DOT2: ab + cd; DOT2_MINUS: ab - cd; with e in front: e + ab + cd, e + ab - cd, e - ab - cd; DOT3, DOT4 go on so. */
enum tl_operation {
  ADD, SUB, MUL, FMA, FMS, FNMA, ADD_K, K_SUB, MUL_K, FMA_K, FMS_K, DIV, K_DIV, SQRT, NEG, SINCOS, EXP, TANH, ATAN2, LESS,
  LESS_EQUAL, WHERE, POWER, DOT2, DOT2_MINUS, E_DOT2, E_DOT2_MINUS, E_MINUS_DOT2, COPY, E_DOT3, E_DOT4, OPERATIONS
};

enum { TL_WIDTHS = 5 }; /* by the binary logarithm of W: 1, -, 4, 8, 16 */
enum { TL_CONTROLS = 10 };
enum { TL_MAX_STAGES = 16, TL_MAX_ERRORS = 2, TL_MAX_ITERATIONS = 1000 };
#define TL_MAX_COUNT (INT64_C(1) << 48) /* numbers of an array: no machine has more */

/* The codes of all outcomes, in the order of `library.OUTCOMES`. */
enum tl_code { TL_FINE, TL_BAD_PROGRAM, TL_NO_MEMORY, TL_TOO_WIDE, TL_BAD_ARGUMENT, TL_NOT_FINITE, TL_NO_SERIES, TL_NO_STEP };

typedef struct {
  int inputs, outputs, registers, constants, scalars;
  size_t quads;
  uint16_t *code[TL_WIDTHS]; /* register numbers times W; NULL where they would not fit into 16 bits */
  double *scalar, *constant; /* operands of K operations; values of constant registers */
  int32_t *constant_at, *output_at;
} tl_program;

/* Some inputs or outputs of many columns: `size` rows, whose numbers lie so many numbers apart by row and by column. */
typedef struct {
  double *at;
  int64_t row, column, size;
} tl_block;

enum tl_kind { TL_EXPLICIT, TL_IMPLICIT, TL_WHOLE };

/* A method on equations of motion x' = f(t, x, p).
rate: (t, x, p) -> x'; of TL_WHOLE, (t, x, p, h) -> x after a step. projection: (x, p) -> x on its manifold, or NULL.
jacobian: (t, x, p) -> the entries (row, column) of df/dx. Tableau: a (stages x stages), b, c, diagonal; errors: rows e.
absolute (size): errors compared with the tolerance alone. joints: rows q begin, end, v begin, end of each. */
typedef struct {
  const tl_program *rate, *projection, *jacobian;
  int size, moving, parameters, kind, adaptive, stages, errors, order, iterations, joints, entries;
  double a[TL_MAX_STAGES][TL_MAX_STAGES], b[TL_MAX_STAGES], c[TL_MAX_STAGES], e[TL_MAX_ERRORS][TL_MAX_STAGES];
  uint8_t *absolute;
  int32_t *joint_rows, *entry_at;
} tl_method;

/* Disturbances of the size of rounding, added to the rows below `moving` of each column before every attempt.
table (period x moving): numbers from -1 to 1. first, rounding, bias: of each column. moves (moving x columns): 0 where
nothing moves. embedded (columns): 1 where a solution goes on by the embedded formula of lower order. parts: begin and end of
the rows whose largest entry sets the least size that counts. */
typedef struct {
  const double *table, *rounding, *bias, *moves, *embedded;
  const int64_t *first;
  int64_t period;
  double share;
  int parts[4];
} tl_disturbance;

/* Numbers of one thread for a method and a width. */
typedef struct {
  const tl_method *method;
  int width;
  void *memory;
  double *x, *control, *parameters, *rate_registers, *projection_registers, *jacobian_registers, *stages, *next, *change, *admitted,
      *matrix, *right;
  int32_t *pivots;
} tl_workspace;

/* A law that acts at ticks: a program (t, rows of the state, kept) -> (torques, kept, zeros), or else a function that writes u
of a tick from one of the states, and gives 0 if it could. times (ticks + 1): of the ticks, and the end. held, limits (torques): where they go, and their bounds. Records: u (ticks, torques, columns), before the bounds; z
(ticks + 1, kept, columns), the first of which is given; at (ticks): the state of each; zeros: divisors that were 0; done. */
typedef struct {
  const tl_program *program;
  double *registers;
  const int32_t *rows, *held;
  const double *limits, *times;
  double *u, *z, *zeros;
  int64_t *at;
  int64_t torques, kept, ticks, done;
  int (*call)(int64_t tick, int64_t state);
} tl_traced_law;

double *tl_registers(const tl_program *program, int width);
int tl_belong(const double *registers, const tl_program *program, int width);
void *tl_copied(const void *from, size_t bytes, int *failed);
void *tl_aligned(size_t bytes);
void tl_free_aligned(void *memory);
int tl_log2(int width);
int tl_quads(int operation);
TL_API int tl_level(void);
TL_API int tl_columns(const tl_program *p, int level, int width, double *registers, int64_t count, int inputs,
                      const tl_block *in, int outputs, const tl_block *out);

/* What is compiled once for each width and processor. */
#define TL_DECLARE(S)                                                                                                         \
  void tl_columns_##S(const tl_program *program, double *registers, int64_t count, int inputs, const tl_block *in,            \
                      int outputs, const tl_block *out);                                                                      \
  int64_t tl_attempts_##S(tl_workspace *work, int64_t columns, int64_t count, int64_t look, double *states,                   \
                          const tl_disturbance *disturbance);                                                                 \
  int64_t tl_ticks_##S(tl_workspace *work, int64_t columns, int64_t count, double *states, const tl_disturbance *disturbance, \
                       tl_traced_law *law);
#endif
