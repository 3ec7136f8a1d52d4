/* W columns side by side as one vector. Included by columns.c once for each W; undone by lanes_end.h. */
#define CAT_(a, b) a##b
#define CAT(a, b) CAT_(a, b)
#define N(name) CAT(CAT(name, _), SUFFIX)
#if W == 1
typedef double N(vector);
typedef int64_t N(mask);
#define SELECT(m, a, b) ((m) ? (a) : (b))
#define IS_LESS(a, b) ((a) < (b))
#define IS_LESS_EQUAL(a, b) ((a) <= (b))
#define LANE(v, l) (*((double *)&(v) + (l)))
#else
typedef double N(vector) __attribute__((vector_size(8 * W), aligned(8 * W), may_alias));
typedef int64_t N(mask) __attribute__((vector_size(8 * W), aligned(8 * W), may_alias));
#define SELECT(m, a, b) ((N(vector))(((N(mask))(m) & (N(mask))(a)) | (~(N(mask))(m) & (N(mask))(b))))
#define IS_LESS(a, b) ((N(mask))((a) < (b)))
#define IS_LESS_EQUAL(a, b) ((N(mask))((a) <= (b)))
#define LANE(v, l) ((v)[l])
#endif
#define V N(vector)
