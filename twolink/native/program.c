/* Making programs: every index is checked once here, so that running them needs no checks. */
#include "program.h"

#include <stdlib.h>
#include <string.h>

static const unsigned char QUADS[OPERATIONS] = {
    [DOT2] = 2, [DOT2_MINUS] = 2, [E_DOT2] = 2, [E_DOT2_MINUS] = 2, [E_MINUS_DOT2] = 2, [E_DOT3] = 2, [E_DOT4] = 3};
static const unsigned char OPERANDS[OPERATIONS] = { /* registers and scalars that follow the result */
    [ADD] = 2, [SUB] = 2, [MUL] = 2, [FMA] = 3, [FMS] = 3, [FNMA] = 3, [ADD_K] = 2, [K_SUB] = 2, [MUL_K] = 2, [FMA_K] = 3,
    [FMS_K] = 3, [DIV] = 2, [K_DIV] = 2, [SQRT] = 1, [NEG] = 1, [SINCOS] = 2, [EXP] = 1, [TANH] = 1, [ATAN2] = 2, [LESS] = 2,
    [LESS_EQUAL] = 2, [WHERE] = 3, [POWER] = 2, [DOT2] = 4, [DOT2_MINUS] = 4, [E_DOT2] = 5, [E_DOT2_MINUS] = 5,
    [E_MINUS_DOT2] = 5, [COPY] = 1, [E_DOT3] = 7, [E_DOT4] = 9};

/* Whether place z of an instruction is the number of a scalar. */
static int is_scalar(int operation, int z) {
  if (z != 2) return 0;
  return operation == ADD_K || operation == K_SUB || operation == MUL_K || operation == FMA_K || operation == FMS_K ||
         operation == K_DIV || operation == POWER;
}

static int is_sound(const tl_program *p, const uint16_t *code) {
  for (size_t i = 0; i < p->quads;) {
    const unsigned operation = code[4 * i], count = code[4 * i + 1];
    if (operation >= OPERATIONS || count == 0) return 0;
    const size_t quads = QUADS[operation] ? QUADS[operation] : 1;
    if (i + 1 + count * quads > p->quads) return 0;
    i++;
    for (unsigned m = 0; m < count; m++, i += quads)
      for (int z = 0; z <= OPERANDS[operation]; z++) {
        const int bound = is_scalar((int)operation, z) ? p->scalars : p->registers;
        if (code[4 * i + (size_t)z] >= bound) return 0;
      }
  }
  for (int i = 0; i < p->outputs; i++)
    if (p->output_at[i] < 0 || p->output_at[i] >= p->registers) return 0;
  for (int i = 0; i < p->constants; i++)
    if (p->constant_at[i] < 0 || p->constant_at[i] >= p->registers) return 0;
  return 1;
}

/* The code with register numbers times W, which are offsets into the registers of W columns. */
static void scale(uint16_t *code, size_t all, int log2) {
  for (size_t i = 0; i < all;) {
    const unsigned operation = code[4 * i], count = code[4 * i + 1];
    const size_t quads = QUADS[operation] ? QUADS[operation] : 1;
    i++;
    for (unsigned m = 0; m < count; m++, i += quads)
      for (int z = 0; z <= OPERANDS[operation]; z++)
        if (!is_scalar((int)operation, z)) code[4 * i + (size_t)z] = (uint16_t)(code[4 * i + (size_t)z] << log2);
  }
}

/* A copy of so many bytes; without memory NULL, and `failed` is set. */
void *tl_copied(const void *from, size_t bytes, int *failed) {
  void *to = malloc(bytes ? bytes : 1);
  if (!to) *failed = 1;
  else if (bytes) memcpy(to, from, bytes);
  return to;
}

TL_API void tl_program_free(tl_program *p) {
  if (!p) return;
  for (int g = 0; g < TL_WIDTHS; g++) free(p->code[g]);
  free(p->scalar);
  free(p->constant);
  free(p->constant_at);
  free(p->output_at);
  free(p);
}

/* A program from its arrays. Returns a code; the program is written to `made`. */
TL_API int tl_program_new(int inputs, int outputs, int registers, int64_t quads, const uint16_t *code, int scalars,
                          const double *scalar, int constants, const int32_t *constant_at, const double *constant,
                          const int32_t *output_at, tl_program **made) {
  if (!made) return TL_BAD_ARGUMENT;
  *made = NULL;
  if (inputs < 0 || outputs < 0 || registers < inputs || registers > 65535 || quads < 0 || quads > (INT64_C(1) << 32) ||
      scalars < 0 || constants < 0 || scalars > 65535 || constants > registers || (quads && !code) || (scalars && !scalar) ||
      (constants && !(constant_at && constant)) || (outputs && !output_at))
    return TL_BAD_PROGRAM;
  tl_program *p = calloc(1, sizeof *p);
  if (!p) return TL_NO_MEMORY;
  int failed = 0;
  p->inputs = inputs, p->outputs = outputs, p->registers = registers, p->quads = (size_t)quads;
  p->scalars = scalars, p->constants = constants;
  p->scalar = tl_copied(scalar, (size_t)scalars * sizeof(double), &failed);
  p->constant = tl_copied(constant, (size_t)constants * sizeof(double), &failed);
  p->constant_at = tl_copied(constant_at, (size_t)constants * sizeof(int32_t), &failed);
  p->output_at = tl_copied(output_at, (size_t)outputs * sizeof(int32_t), &failed);
  if (!failed && !is_sound(p, code)) {
    tl_program_free(p);
    return TL_BAD_PROGRAM;
  }
  for (int g = 0; g < TL_WIDTHS && !failed; g++) {
    if (g == 1 || ((int64_t)registers << g) > 65536) continue;
    p->code[g] = tl_copied(code, p->quads * 4 * sizeof(uint16_t), &failed);
    if (!failed) scale(p->code[g], p->quads, g);
  }
  if (failed) {
    tl_program_free(p);
    return TL_NO_MEMORY;
  }
  *made = p;
  return TL_FINE;
}

int tl_quads(int operation) { return QUADS[operation] ? QUADS[operation] : 1; }

int tl_log2(int width) {
  return width == 1 ? 0 : width == 4 ? 2 : width == 8 ? 3 : width == 16 ? 4 : -1;
}

void *tl_aligned(size_t bytes) { /* zeros, on a cache line */
  char *memory = bytes < SIZE_MAX / 2 ? calloc(bytes + 256, 1) : NULL;
  if (!memory) return NULL;
  void **at = (void **)(((uintptr_t)memory + 152) & ~(uintptr_t)127); /* at least 24 bytes on */
  at[-1] = memory;
  return at;
}

void tl_free_aligned(void *memory) {
  if (memory) free(((void **)memory)[-1]);
}

/* The registers of a program for W columns, with its constants. Before them stands what they were made for. */
double *tl_registers(const tl_program *p, int width) {
  double *registers = tl_aligned(((size_t)p->registers + 1) * (size_t)width * sizeof(double));
  if (!registers) return NULL;
  ((const void **)registers)[-2] = p;
  ((int *)registers)[-6] = width;
  for (int i = 0; i < p->constants; i++)
    for (int l = 0; l < width; l++) registers[p->constant_at[i] * width + l] = p->constant[i];
  return registers;
}

int tl_belong(const double *registers, const tl_program *p, int width) {
  return ((const void *const *)registers)[-2] == p && ((const int *)registers)[-6] == width;
}
