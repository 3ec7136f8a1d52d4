/* Running a program on W columns. The same text for every W, and so the same bits in every column of every width. */

/* Sine and cosine of angles below 1e6: by k = round(x / pi), r = x - k pi with pi in three parts (Cody, Waite: Software
Manual for the Elementary Functions, 1980), and minimax polynomials of r in pairs. Beyond, and of what is not finite, libm.
Errors: below 2 units in the last place of 1. */
static inline void N(sincos)(V x, V *s, V *c) {
  int far = 0;
  for (int l = 0; l < W; l++) far |= !(fabs(LANE(x, l)) < 1e6);
  const double shift = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to whole numbers */
  V k = (x * 0.3183098861837907 + shift) - shift;
  V r = (x - k * 3.1415926534682512) - (k * 1.2154201012607932e-10 + k * 4.044532497591901e-21);
  V half = k * 0.5, odd = half - ((half + shift) - shift), sign = 1.0 - 8.0 * (odd * odd), z = r * r, w = z * z;
  V s01 = -0.16666666666666666 + z * 0.008333333333333115, s23 = -0.00019841269841185916 + z * 2.7557319207779548e-06;
  V s45 = -2.505210660597676e-08 + z * 1.605892780373394e-10, s67 = -7.642712083562756e-13 + z * 2.7184875231569606e-15;
  V w2 = w * w, sines = (s01 + s23 * w) + (s45 + s67 * w) * w2;
  V c01 = 0.04166666666666583 + z * -0.0013888888888830076, c23 = 2.4801587285786695e-05 + z * -2.755731706854842e-07;
  V c45 = 2.087659258309319e-09 + z * -1.1463634914557878e-11;
  V cosines = (c01 + c23 * w) + (c45 + w * 4.6161268699764185e-14) * w2;
  *s = sign * (r + r * (z * sines));
  *c = sign * (1.0 + z * (z * cosines - 0.5));
  if (__builtin_expect(far, 0)) /* only the columns that are: no column's bits depend on its neighbours */
    for (int l = 0; l < W; l++) {
      const double y = LANE(x, l);
      if (!(fabs(y) < 1e6)) LANE(*s, l) = sin(y), LANE(*c, l) = cos(y);
    }
}

/* Number z of an instruction. A quad is loaded at once, which takes less time than four numbers; its first is the lowest on
all processors that the library is built for. */
#define PLACE(z) (((z) < 4 ? quad0 : (z) < 8 ? quad1 : quad2) >> (16 * ((z) % 4)) & 0xffff)
#define REGISTER(z) (*(const V *)(registers + PLACE(z)))
#define RESULT (*(V *)(registers + PLACE(0)))
#define A REGISTER(1)
#define B REGISTER(2)
#define C REGISTER(3)
#define D REGISTER(4)
#define E REGISTER(5)
#define F REGISTER(6)
#define G REGISTER(7)
#define K (scalar[PLACE(2)])
#define RUN(operation, quads, body) \
  case operation:                   \
    for (; n > 0; n--, q += 4 * (quads)) {                          \
      uint64_t quad0, quad1 = 0, quad2 = 0;                         \
      memcpy(&quad0, q, sizeof quad0);                              \
      if ((quads) > 1) memcpy(&quad1, q + 4, sizeof quad1);         \
      if ((quads) > 2) memcpy(&quad2, q + 8, sizeof quad2);         \
      (void)quad1, (void)quad2;                                     \
      body;                                                         \
    }                                                               \
    break;
#define BY_LANE(expression)                  \
  {                                          \
    V a_ = A, o_;                            \
    for (int l = 0; l < W; l++) {            \
      const double x_ = LANE(a_, l);         \
      LANE(o_, l) = (expression);            \
    }                                        \
    RESULT = o_;                             \
  }

/* Operands are read before the result is written: a result may take the register of an operand that is used up. */
static void N(evaluate)(const tl_program *p, double *registers) {
  const uint16_t *q = p->code[LOG2_W], *end = q + 4 * p->quads;
  const double *scalar = p->scalar;
  const V zero = {0};
  while (q < end) {
    const int operation = q[0];
    long n = q[1];
    q += 4;
    switch (operation) {
      RUN(ADD, 1, RESULT = A + B)
      RUN(SUB, 1, RESULT = A - B)
      RUN(MUL, 1, RESULT = A * B)
      RUN(FMA, 1, RESULT = A * B + C)
      RUN(FMS, 1, RESULT = A * B - C)
      RUN(FNMA, 1, RESULT = C - A * B)
      RUN(ADD_K, 1, RESULT = A + K)
      RUN(K_SUB, 1, RESULT = K - A)
      RUN(MUL_K, 1, RESULT = A * K)
      RUN(FMA_K, 1, RESULT = A * K + C)
      RUN(FMS_K, 1, RESULT = A * K - C)
      RUN(DOT2, 2, V x = A * B; RESULT = C * D + x)
      RUN(DOT2_MINUS, 2, V x = A * B; RESULT = x - C * D)
      RUN(E_DOT2, 2, V x = A * B + E; RESULT = C * D + x)
      RUN(E_DOT2_MINUS, 2, V x = A * B + E; RESULT = x - C * D)
      RUN(E_MINUS_DOT2, 2, V x = E - A * B; RESULT = x - C * D)
      RUN(E_DOT3, 2, V x = A * B + E; x = C * D + x; RESULT = F * G + x)
      RUN(E_DOT4, 3, V x = A * B + E; x = C * D + x; x = F * G + x; RESULT = REGISTER(8) * REGISTER(9) + x)
      RUN(DIV, 1, RESULT = A / B)
      RUN(K_DIV, 1, RESULT = K / A)
      RUN(NEG, 1, RESULT = -A)
      RUN(COPY, 1, RESULT = A)
      RUN(SINCOS, 1, V s_; V c_; N(sincos)(A, &s_, &c_); RESULT = s_; *(V *)(registers + PLACE(2)) = c_)
      RUN(SQRT, 1, BY_LANE(sqrt(x_)))
      RUN(EXP, 1, BY_LANE(exp(x_)))
      RUN(TANH, 1, BY_LANE(tanh(x_)))
      RUN(POWER, 1, BY_LANE(pow(x_, K)))
      RUN(ATAN2, 1, V b_ = B; BY_LANE(atan2(x_, LANE(b_, l))))
      RUN(LESS, 1, RESULT = SELECT(IS_LESS(A, B), zero + 1.0, zero))
      RUN(LESS_EQUAL, 1, RESULT = SELECT(IS_LESS_EQUAL(A, B), zero + 1.0, zero))
      RUN(WHERE, 1, V a_ = A; V b_ = B; V c_ = C; RESULT = SELECT(IS_LESS(zero, a_) | IS_LESS(a_, zero), b_, c_))
      default: return;
    }
  }
}
#undef PLACE
#undef REGISTER
#undef RESULT
#undef A
#undef B
#undef C
#undef D
#undef E
#undef F
#undef G
#undef K
#undef RUN
#undef BY_LANE

/* Results of `count` columns, from and to blocks that lie one behind the other in the inputs and the outputs. */
void N(tl_columns)(const tl_program *p, double *registers, int64_t count, int inputs, const tl_block *in, int outputs,
                   const tl_block *out) {
  for (int64_t s = 0; s < count; s += W) {
    const int width = count - s < W ? (int)(count - s) : W;
    double *to = registers;
    for (const tl_block *b = in; b < in + inputs; b++)
      for (int64_t i = 0; i < b->size; i++, to += W) {
        const double *from = b->at + i * b->row + s * b->column;
        if (width == W && b->column == 1) memcpy(to, from, W * sizeof(double));
        else
          for (int l = 0; l < W; l++) to[l] = from[(l < width ? l : 0) * b->column];
      }
    N(evaluate)(p, registers);
    const int32_t *output = p->output_at;
    for (const tl_block *b = out; b < out + outputs; b++)
      for (int64_t i = 0; i < b->size; i++, output++) {
        const double *from = registers + *output * W;
        double *place = b->at + i * b->row + s * b->column;
        if (width == W && b->column == 1) memcpy(place, from, W * sizeof(double));
        else
          for (int l = 0; l < width; l++) place[l * b->column] = from[l];
      }
  }
}
