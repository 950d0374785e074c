/* Exact determinants, as sums of doubles that do not overlap (Shewchuk 1997): a part of faces.c,
 * solid.c and bvh.c. They are exact unless coordinates span more than 130 orders of magnitude. */

#define SPLITTER 0x1.000002p27
#define MOST_PARTS 192

/* A number as a sum of doubles, the smallest first; no two have a bit in common. */
typedef struct {
    int size;
    double part[MOST_PARTS];
} Sum;

static double two_sum(double a, double b, double *low) {
    double sum = a + b, other = sum - a;
    *low = (a - (sum - other)) + (b - other);
    return sum;
}

static double high_half(double a) {
    double c = SPLITTER * a;
    return c - (c - a);
}

static double two_product(double a, double b, double *low) {
    double product = a * b, p = high_half(a), q = high_half(b), r = a - p, s = b - q;
    *low = r * s - (((product - p * q) - r * q) - p * s);
    return product;
}

static void append(Sum *sum, double part) {
    if (part != 0) sum->part[sum->size++] = part;
}

static void set_difference(Sum *sum, double a, double b) {
    double low, high = two_sum(a, -b, &low);
    sum->size = 0;
    append(sum, low), append(sum, high);
}

static void add(const Sum *a, const Sum *b, Sum *sum) {
    double high = 0, low;
    sum->size = 0;
    for (int i = 0, j = 0; i < a->size || j < b->size;) {
        int first = j == b->size || (i < a->size && fabs(a->part[i]) < fabs(b->part[j]));
        high = two_sum(high, first ? a->part[i++] : b->part[j++], &low);
        append(sum, low);
    }
    append(sum, high);
}

static void scale(const Sum *a, double factor, Sum *product) {
    double high = 0, low;
    product->size = 0;
    for (int i = 0; i < a->size; i++) {
        double below, above = two_product(a->part[i], factor, &below);
        high = two_sum(high, below, &low);
        append(product, low);
        high = two_sum(above, high, &low);
        append(product, low);
    }
    append(product, high);
}

/* Multiply by a difference, which has two parts at most. */
static void multiply(const Sum *a, const Sum *difference, Sum *product) {
    Sum one, other;
    one.size = other.size = 0;
    if (difference->size > 0) scale(a, difference->part[0], &one);
    if (difference->size > 1) scale(a, difference->part[1], &other);
    add(&one, &other, product);
}

/* a b - c d, of differences. */
static void cross_product(const Sum *a, const Sum *b, const Sum *c, const Sum *d, Sum *result) {
    Sum one, other;
    multiply(a, b, &one), multiply(c, d, &other);
    for (int i = 0; i < other.size; i++) other.part[i] = -other.part[i];
    add(&one, &other, result);
}

/* The value of a sum. Its largest part alone has the sign, but may have few of the digits. */
static double value_of(const Sum *sum) {
    double value = 0;
    for (int i = 0; i < sum->size; i++) value += sum->part[i];
    return value;
}

/* Twice the area of a triangle a, b, c, seen along the axis that is neither x nor y. */
static double exact_area(const double *a, const double *b, const double *c, int x, int y) {
    Sum ax, ay, bx, by, exact;
    set_difference(&ax, a[x], c[x]), set_difference(&ay, a[y], c[y]);
    set_difference(&bx, b[x], c[x]), set_difference(&by, b[y], c[y]);
    cross_product(&ax, &by, &ay, &bx, &exact);
    return value_of(&exact);
}

/* Six times the volume of a tetrahedron. */
static double exact_volume(const double *a, const double *b, const double *c, const double *p) {
    Sum u[3], v[3], w[3], minor, term, one, other;
    for (int k = 0; k < 3; k++) {
        set_difference(u + k, a[k], p[k]), set_difference(v + k, b[k], p[k]);
        set_difference(w + k, c[k], p[k]);
    }
    one.size = 0;
    for (int k = 0; k < 3; k++) {
        int x = (k + 1) % 3, y = (k + 2) % 3;
        cross_product(u + x, v + y, u + y, v + x, &minor);
        multiply(&minor, w + k, &term);
        other = one;
        add(&other, &term, &one);
    }
    return value_of(&one);
}
