/* Steps of Taylor's method of one solution, and its samples: values of the polynomial of the step that they are in. */

/* The series of the inputs and of what is constant at the start: x (moving x C), constants. */
void N(tl_taylor_begin)(tl_taylor *one, const double *x, const double *constants) {
  const tl_recurrences *own = one->own;
  const int32_t next = (int32_t)one->stride * C;
  for (int n = 1; n <= one->order; n++) N(stored)(one->inverse + n, TL_MAX_ORDER + 1, N(over)(N(of)(1.0), N(of)(n)));
  for (int i = 0; i < own->moving; i++)
    for (int c = 0; c < C; c++) one->series[(1 + i) * next + (int32_t)one->stride * c] = x[i * C + c];
  for (int i = 1 + own->moving; i < own->inputs; i++) one->series[i * next] = constants[i - 1 - own->moving];
  for (int i = 0; i < own->literals; i++) one->series[own->literal_at[i]] = own->literal[i];
  N(recur)(one, own->once, own->once_count, 0);
  one->series[1] = 1.0;
}

/* t - time. */
static NUMBER N(since)(const tl_taylor *one, double t) {
  double sum[TL_TIME_PARTS];
  for (int i = 0; i < TL_TIME_PARTS; i++) sum[i] = -one->time[i];
  tl_add(TL_TIME_PARTS, sum, 0, t);
  for (int from = 0; from < TL_TIME_PARTS - 1; from++)
    for (int i = TL_TIME_PARTS - 2; i >= from; i--) tl_two_sum(sum[i], sum[i + 1], &sum[i], &sum[i + 1]);
  return N(normal)(sum);
}

/* x(time + h) into `out` (rows x C), whose parts lie `row` and `part` numbers apart. */
static void N(polynomial)(tl_taylor *one, NUMBER h, double *out, size_t row, size_t part) {
  const size_t next = one->stride * C;
  NUMBER power = h;
  for (int n = 1; n <= one->order; n++) {
    N(stored)(one->powers + n, one->stride, power);
    power = N(times)(power, h);
  }
  for (int i = 0; i < one->own->moving; i++) {
    const double *x = one->series + (size_t)(1 + i) * next;
    tl_vector sum[C] = {{0}};
    double total[C] = {0};
    for (int n = 0; n <= one->order; n += TL_W) { /* powers[0] is 0 */
      tl_vector a[C], b[C];
      for (int c = 0; c < C; c++) {
        memcpy(&a[c], x + (size_t)c * one->stride + n, sizeof a[c]);
        memcpy(&b[c], one->powers + (size_t)c * one->stride + n, sizeof b[c]);
      }
      tl_vector_add_product(C, sum, a, b);
    }
    N(folded)(total, sum);
    N(stored)(out + (size_t)i * row, part, N(plus)(N(loaded)(x, one->stride), N(normal)(total)));
  }
}

/* Adds a disturbance of the size of rounding to x, as `disturb` of steps.h does. */
static void N(disturb_series)(tl_taylor *one, const tl_disturbance *d) {
  const int moving = one->own->moving;
  const size_t next = one->stride * C;
  const double *random = d->table + ((one->steps + d->first[0]) % d->period) * moving;
  double least[2] = {0.0, 0.0};
  for (int k = 0; k < 2; k++)
    for (int i = d->parts[2 * k]; i < d->parts[2 * k + 1]; i++) least[k] = fmax(least[k], fabs(one->series[(size_t)(1 + i) * next]));
  for (int i = 0; i < moving; i++) {
    double *x = one->series + (size_t)(1 + i) * next;
    const int k = i >= d->parts[2] && i < d->parts[3] ? 1 : i >= d->parts[0] && i < d->parts[1] ? 0 : -1;
    const double size = fmax(fabs(x[0]), k < 0 ? 0.0 : d->share * least[k]);
    const double added = (random[i] * (d->rounding[0] * size) + d->bias[0] * x[0]) * d->moves[i];
    N(stored)(x, one->stride, N(plus)(N(loaded)(x, one->stride), N(of)(added)));
  }
}

/* The largest of the last coefficients, those of x_n for n = order - back, and the largest of x. NaN where one is not finite. */
static double N(largest)(const tl_taylor *one, int n) {
  const tl_recurrences *own = one->own;
  double most = 0.0, total = 0.0;
  for (int i = 0; i < own->outputs; i++) {
    const double size = own->is_constant[i] ? 0.0 : fabs(one->series[own->output[i] + n - 1] / n);
    total += size, most = fmax(most, size);
  }
  return total <= 1.7e308 ? most : NAN;
}

/* The series of a step from x, and its length (Jorba, Zou 2005, with the factors of Biscani, Izzo: MNRAS 504 (2021) 2614):

h = e^(-2 - 0.7 / (p - 1)) min over n = p - 1, p of (max(1, |x|) / |x_n|)^(1/n),   p the order */
static int N(expand)(tl_taylor *one) {
  const tl_recurrences *own = one->own;
  const int p = one->order;
  const size_t next = one->stride * C;
  double size = 1.0, h = one->longest;
  N(stored)(one->series, one->stride, N(negative)(N(since)(one, 0.0)));
  for (int i = 0; i < own->moving; i++) size = fmax(size, fabs(one->series[(size_t)(1 + i) * next]));
  for (int n = 0; n < p; n++) {
    N(recur)(one, own->each, own->each_count, n);
    for (int i = 0; i < own->moving; i++) {
      const int32_t from = own->output[i];
      const NUMBER rate = n && own->is_constant[i] ? N(of)(0.0) : N(at)(one, from, n);
      N(stored)(one->series + (size_t)(1 + i) * next + n + 1, one->stride, N(by_order)(one, rate, n + 1));
    }
  }
  for (int n = p - 1; n <= p; n++) {
    const double last = N(largest)(one, n);
    if (!(last >= 0.0)) return TL_NOT_FINITE;
    if (last > 0.0) h = fmin(h, pow(size / last, 1.0 / n) * exp(-2.0 - 0.7 / (p - 1)));
  }
  if (!(h > 0.0) || !(size <= 1e300)) return TL_NOT_FINITE;
  one->step = h, one->open = 1;
  return TL_FINE;
}

/* x at the end of the step, where the next one begins. */
static void N(pass)(tl_taylor *one) {
  const int moving = one->own->moving;
  N(polynomial)(one, N(of)(one->step), one->state, C, 1);
  for (int i = 0; i < moving; i++)
    for (int c = 0; c < C; c++) one->series[((size_t)(1 + i) * C + (size_t)c) * one->stride] = one->state[i * C + c];
  tl_add(TL_TIME_PARTS, one->time, 0, one->step);
  one->open = 0;
}

/* Samples (count x moving x C) at times, up to `limit` steps: how many samples were made, or a code below 0. disturbance: of one
column, or NULL. */
int64_t N(tl_taylor_advance)(tl_taylor *one, int64_t count, const double *times, double *out, const tl_disturbance *disturbance,
                             int64_t limit) {
  const size_t row = (size_t)one->own->moving * C;
  for (int64_t done = 0;; limit--) {
    for (; one->open && done < count; done++) {
      const NUMBER h = N(since)(one, times[done]);
      if (!(h.part[0] <= one->step)) break;
      N(polynomial)(one, h, out + (size_t)done * row, C, 1);
    }
    if (done == count || limit <= 0) return done;
    if (one->open) N(pass)(one);
    if (disturbance && disturbance->rounding[0] != 0.0) N(disturb_series)(one, disturbance);
    const int code = N(expand)(one);
    if (code) return -code;
    one->steps++;
  }
}

#undef C
#undef NUMBER
#undef SUFFIX
#undef N
#undef CAT
#undef CAT_
