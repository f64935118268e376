# advance(n, h) takes a step h of z[1] to z[n] by Runge-Kutta's method of order 4. The program that includes this text
# has the function rates(y, d), which writes the rates of y[1] to y[n] to d[1] to d[n].
function advance(n, h,    i, y, a, b, c, d) {
    rates(z, a)
    for (i = 1; i <= n; ++i) y[i] = z[i] + h / 2 * a[i]
    rates(y, b)
    for (i = 1; i <= n; ++i) y[i] = z[i] + h / 2 * b[i]
    rates(y, c)
    for (i = 1; i <= n; ++i) y[i] = z[i] + h * c[i]
    rates(y, d)
    for (i = 1; i <= n; ++i) z[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i])
}
