/* Reference states of the stiff test problems: explicit Taylor series of degree 24 in numbers of 113 bits.
 *
 *     gcc -O2 taylor.c -o taylor -lquadmath -lm && ./taylor 1.0 2e-6 && ./taylor 0.7 1e-6
 *
 * The arguments are a factor on the steps that the last two coefficients allow, and the longest step for van der Pol.
 */
#include <quadmath.h>
#include <stdio.h>
#include <stdlib.h>

#define DEGREE 24
typedef __float128 real;

static void show(const char *name, real t, const real *y, int count) {
    char digits[64];
    printf("%s t=%g:", name, (double)t);
    for (int i = 0; i < count; i++) {
        quadmath_snprintf(digits, sizeof digits, "%.25Qe", y[i]);
        printf(" %s", digits);
    }
    printf("\n");
    fflush(stdout);
}

/* The step at which the last two terms of a series are below the tolerance. */
static real longest(const real *c, real scale, real tolerance) {
    real last = fabsq(c[DEGREE]) / scale + 1e-300Q, before = fabsq(c[DEGREE - 1]) / scale + 1e-300Q;
    return fminq(powq(tolerance / last, 1.0Q / DEGREE), powq(tolerance / before, 1.0Q / (DEGREE - 1)));
}

static real at(const real *c, real h) {
    real sum = c[DEGREE];
    for (int k = DEGREE - 1; k >= 0; k--) sum = sum * h + c[k];
    return sum;
}

static void van_der_pol(real safety, real cap) {
    const real epsilon = 1e-6Q, end = 2;
    real y = 2, z = 0, t = 0;
    long steps = 0;
    while (t < end) {
        real a[DEGREE + 1] = {y}, b[DEGREE + 1] = {z}, square[DEGREE + 1];
        for (int k = 0; k < DEGREE; k++) {
            square[k] = 0;
            for (int i = 0; i <= k; i++) square[k] += a[i] * a[k - i];
            real force = b[k];
            for (int i = 0; i <= k; i++) force -= square[i] * b[k - i];
            a[k + 1] = b[k] / (k + 1);
            b[k + 1] = (force - a[k]) / epsilon / (k + 1);
        }
        real h = fminq(safety * longest(b, fabsq(b[0]) + 1, 1e-26Q), cap);
        if (t + h > end) h = end - t;
        y = at(a, h), z = at(b, h), t += h, steps++;
    }
    show("van der Pol", t, (real[]){y, z}, 2);
    printf("%ld steps\n", steps);
}

static void robertson(real safety) {
    const real outputs[] = {0.4Q, 4, 40, 400, 4000};
    real y[3] = {1, 0, 0}, t = 0;
    long steps = 0;
    for (int output = 0; output < 5;) {
        real a[DEGREE + 1] = {y[0]}, b[DEGREE + 1] = {y[1]}, c[DEGREE + 1] = {y[2]};
        for (int k = 0; k < DEGREE; k++) {
            real bc = 0, bb = 0;
            for (int i = 0; i <= k; i++) bc += b[i] * c[k - i], bb += b[i] * b[k - i];
            real first = 0.04Q * a[k], second = 3e7Q * bb, third = 1e4Q * bc;
            a[k + 1] = (third - first) / (k + 1);
            b[k + 1] = (first - third - second) / (k + 1);
            c[k + 1] = second / (k + 1);
        }
        real h = safety * longest(b, 1e-5Q, 1e-24Q);
        int reached = t + h >= outputs[output];
        if (reached) h = outputs[output] - t;
        y[0] = at(a, h), y[1] = at(b, h), y[2] = at(c, h), t += h, steps++;
        if (reached) {
            t = outputs[output++];
            show("Robertson", t, y, 3);
        }
    }
    printf("%ld steps\n", steps);
}

int main(int count, char **arguments) {
    real safety = count > 1 ? strtoflt128(arguments[1], NULL) : 1, cap = count > 2 ? strtoflt128(arguments[2], NULL) : 2e-6Q;
    van_der_pol(safety, cap);
    robertson(safety);
}
