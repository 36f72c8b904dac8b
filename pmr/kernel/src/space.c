/* Vectors in space and rotations R (3, 3). */

static double dot_three(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double *a, const double *b, double *c)
{
    const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    c[0] = x, c[1] = y, c[2] = z;
}

static void turn_out(const double *R, const double *a, double *b) /* R a */
{
    const double x = a[0], y = a[1], z = a[2];
    int i;
    for (i = 0; i < 3; i++) b[i] = R[3 * i] * x + R[3 * i + 1] * y + R[3 * i + 2] * z;
}

static void turn_in(const double *R, const double *a, double *b) /* R^T a */
{
    const double x = a[0], y = a[1], z = a[2];
    int i;
    for (i = 0; i < 3; i++) b[i] = R[i] * x + R[3 + i] * y + R[6 + i] * z;
}

static void add_cross(double factor, const double *a, const double *b, double *sum)
{
    double c[3];
    int i;
    cross(a, b, c);
    for (i = 0; i < 3; i++) sum[i] += factor * c[i];
}

/* x of A x = b (3, 3), or of A^T x = b, by Cramer's rule. */
static void solve_three(const double *A, int transposed, const double *b, double *x)
{
    double columns[3][3], minors[3][3], size = 0.0;
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) columns[i][j] = transposed ? A[3 * i + j] : A[3 * j + i];
    for (i = 0; i < 3; i++) cross(columns[(i + 1) % 3], columns[(i + 2) % 3], minors[i]);
    for (i = 0; i < 3; i++) size += columns[0][i] * minors[0][i];
    for (i = 0; i < 3; i++) columns[0][i] = (minors[i][0] * b[0] + minors[i][1] * b[1] + minors[i][2] * b[2]) / size;
    copy(x, columns[0], 3);
}
