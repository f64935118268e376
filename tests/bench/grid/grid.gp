# Draws the table of bench_grid: CPU time of a run against its error, for slow and fast conduction.
# `table` is the CSV, `picture` the file to write.
set terminal pngcairo size 1100,450 font 'DejaVu Sans,10' background 'white'
set output picture
set datafile separator ','
set logscale xy
set format x '10^{%L}'
set format y '10^{%L}'
set grid lc rgb '#dddddd'
set xlabel 'relative L2 error at the end'
set ylabel 'CPU time, s'
set xrange [1:1e-12]
set key outside right top Left reverse samplen 2 font ',8'
methods = '"CVODE Adams" "CVODE BDF KLU" heun rk4 rk6 rk4_balanced rk6_balanced'
colours = '#000000 #000000 #c49c00 #1f77b4 #d62728 #1f77b4 #d62728'
shapes = '5 4 7 7 7 6 6'
rows(system, method) = sprintf("< grep '^%s,%s,' '%s'", system, method, table)
set multiplot layout 1,2
do for [system in 'slow fast'] {
    set title (system eq 'slow' ? 'K = 0.05 W/K' : 'K = 10 W/K')
    plot for [i = 1:words(methods)] rows(system, word(methods, i)) using 5:4 with linespoints \
             lc rgb word(colours, i) pt int(word(shapes, i)) ps 0.7 title word(methods, i) noenhanced
}
unset multiplot
