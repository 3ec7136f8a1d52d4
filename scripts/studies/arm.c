/* Runs a program of the machine that it reads from stdin, in each width, and writes the outputs: for scripts/studies/arm.py.

int32: inputs, outputs, registers, quads, scalars, constants, columns. Then code, scalars, constant_at, constants, output_at
and the columns' numbers (columns x inputs), row by row. */
#include "../../twolink/native/program.h"

#include <stdio.h>
#include <stdlib.h>

TL_API int tl_level(void);
int tl_program_new(int, int, int, int64_t, const uint16_t *, int, const double *, int, const int32_t *, const double *,
                   const int32_t *, tl_program **);
double *tl_registers_new(const tl_program *, int);
int tl_columns(const tl_program *, int, int, double *, int64_t, int, const tl_block *, int, const tl_block *);

static void *taken(size_t size, size_t count) {
  void *memory = calloc(count + 1, size);
  if (!memory || fread(memory, size, count, stdin) != count) exit(2);
  return memory;
}

int main(void) {
  const int32_t *n = taken(sizeof(int32_t), 7);
  const uint16_t *code = taken(2, 4 * (size_t)n[3]);
  const double *scalar = taken(8, (size_t)n[4]);
  const int32_t *constant_at = taken(4, (size_t)n[5]);
  const double *constant = taken(8, (size_t)n[5]);
  const int32_t *output_at = taken(4, (size_t)n[1]);
  double *x = taken(8, (size_t)n[0] * (size_t)n[6]), *y = calloc((size_t)n[1] * (size_t)n[6] + 1, 8);
  tl_program *program;
  if (tl_program_new(n[0], n[1], n[2], n[3], code, n[4], scalar, n[5], constant_at, constant, output_at, &program)) return 3;
  const tl_block in = {x, 1, n[0], n[0]}, out = {y, 1, n[1], n[1]};
  const int widths[4] = {1, 4, 8, 16};
  for (int i = 0; i < 4; i++) {
    double *registers = tl_registers_new(program, widths[i]);
    if (!registers || tl_columns(program, tl_level(), widths[i], registers, n[6], 1, &in, 1, &out)) return 4;
    fwrite(y, 8, (size_t)n[1] * (size_t)n[6], stdout);
  }
  return 0;
}
