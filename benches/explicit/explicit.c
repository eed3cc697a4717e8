/* Explicit steps of a mass-spring system as anyone would write them: what the machine can do with this layout of data, one thread.
   explicit FOLDER reads what `ours.rs` exported there; every line "KIND STEPS" on its input is answered with the nanoseconds of
   processor time that a step took, and "positions FILE" writes where the particles are. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct { double x, y, z; } vec;
typedef struct { double k, l0, b; } spring;

static vec *x, *v, *p, *f, *g;
static double *m;
static spring *s;
static unsigned (*end)[2], *held;
static long particles, springs, fixed, forces_known;

static void *read_all(const char *folder, const char *name, size_t size, long *count) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s.bin", folder, name);
    FILE *file = fopen(path, "rb");
    if (!file) { perror(path); exit(1); }
    fseek(file, 0, SEEK_END);
    *count = ftell(file) / (long)size;
    rewind(file);
    void *data = malloc(*count * size + 1);
    if (fread(data, size, *count, file) != (size_t)*count) exit(1);
    fclose(file);
    return data;
}

static void add(vec *a, const vec *b, double c) { a->x += b->x * c, a->y += b->y * c, a->z += b->z * c; }

static void forces(const vec *v) {
    for (long a = 0; a < particles; a++) f[a] = (vec){m[a] * g->x, m[a] * g->y, m[a] * g->z};
    for (long a = 0; a < springs; a++) {
        unsigned i = end[a][0], j = end[a][1];
        vec d = {x[i].x - x[j].x, x[i].y - x[j].y, x[i].z - x[j].z};
        double l = sqrt(d.x * d.x + d.y * d.y + d.z * d.z), t = s[a].k * (l - s[a].l0) / s[a].l0;
        if (s[a].b > 0) t += s[a].b * (d.x * (v[i].x - v[j].x) + d.y * (v[i].y - v[j].y) + d.z * (v[i].z - v[j].z)) / l;
        add(&f[i], &d, -t / l), add(&f[j], &d, t / l);
    }
}

static void symplectic_euler(double h) {
    forces(v);
    for (long a = 0; a < particles; a++) add(&v[a], &f[a], h / m[a]);
    for (long a = 0; a < fixed; a++) v[held[a]] = (vec){0, 0, 0};
    for (long a = 0; a < particles; a++) add(&x[a], &v[a], h);
}

static void verlet(double h) {
    if (!forces_known++) forces(v);
    for (long a = 0; a < particles; a++) add(&v[a], &f[a], 0.5 * h / m[a]);
    for (long a = 0; a < fixed; a++) v[held[a]] = (vec){0, 0, 0};
    for (long a = 0; a < particles; a++) add(&x[a], &v[a], h), p[a] = v[a], add(&p[a], &f[a], 0.5 * h / m[a]);
    for (long a = 0; a < fixed; a++) p[held[a]] = (vec){0, 0, 0};
    forces(p);
    for (long a = 0; a < particles; a++) add(&v[a], &f[a], 0.5 * h / m[a]);
    for (long a = 0; a < fixed; a++) v[held[a]] = (vec){0, 0, 0};
}

int main(int count, char **arguments) {
    if (count < 2) return 2;
    const char *folder = arguments[1];
    long one;
    x = read_all(folder, "positions", sizeof *x, &particles), v = read_all(folder, "velocities", sizeof *v, &particles);
    m = read_all(folder, "masses", sizeof *m, &particles), g = read_all(folder, "gravity", sizeof *g, &one);
    end = read_all(folder, "springs", sizeof *end, &springs), s = read_all(folder, "parameters", sizeof *s, &springs);
    held = read_all(folder, "held", sizeof *held, &fixed);
    p = calloc(particles, sizeof *p), f = calloc(particles, sizeof *f);
    char kind[64], what[4096];
    while (scanf("%63s %4095s", kind, what) == 2) {
        if (!strcmp(kind, "positions")) {
            FILE *file = fopen(what, "wb");
            if (!file || fwrite(x, sizeof *x, particles, file) != (size_t)particles || fclose(file)) return 1;
            puts("0");
            fflush(stdout);
            continue;
        }
        long steps = atol(what);
        struct timespec from, to;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &from);
        for (long step = 0; step < steps; step++)
            if (!strcmp(kind, "forces")) forces(v);
            else if (!strcmp(kind, "verlet")) verlet(1e-5);
            else symplectic_euler(1e-5);
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &to);
        printf("%.1f\n", ((to.tv_sec - from.tv_sec) * 1e9 + (to.tv_nsec - from.tv_nsec)) / steps);
        fflush(stdout);
    }
}
