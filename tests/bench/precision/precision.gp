# Draws the tables of precision.sh, which are in `folder`: run time against the method's own error, and
# against that from physics, for slow and fast conduction.
set terminal pngcairo size 1100,900 font 'DejaVu Sans,10' background 'white'
set output folder.'/precision.png'
set datafile separator ','
set logscale xy
set format x '10^{%L}'
set format y '10^{%L}'
set grid lc rgb '#dddddd'
set xlabel 'relative L2 error, median'
set key Left reverse samplen 2 font ',8'
methods = 'euler heun rk4 rk4_balanced rk6 rk6_balanced discrete_gradient rk4_adaptive'
colours = '#999999 #c49c00 #1f77b4 #1f77b4 #d62728 #d62728 #8c564b #8c564b #9467bd #17becf'
rows(file, scene, method) = sprintf("< grep '^%s,%s' '%s/%s.csv'", scene, method, folder, file)
dashed(method) = strstrt(method, 'balanced') > 0 ? 2 : 1
set yrange [2e-6:0.1]

set multiplot layout 2,2
do for [scene in 'double_pendulum double_pendulum_fast'] {
    do for [column in 'own all'] {
        set title (scene eq 'double_pendulum' ? 'slow conduction' : 'fast conduction').', error against '.\
            (column eq 'own' ? 'the learned equations' : 'physics') noenhanced
        set ylabel (column eq 'own' ? 'time per simulated second, s' : '')
        if (column eq 'own') { set key bottom left } else { set key top right }
        set xrange [2 : column eq 'own' ? 1e-12 : 1e-9]
        e = column eq 'own' ? 6 : 7
        plot for [i = 1:words(methods)] rows('table', scene, word(methods, i).',') using e:5 \
                 with linespoints lc rgb word(colours, i) dt dashed(word(methods, i)) pt 7 ps 0.5 \
                 title word(methods, i) noenhanced, \
             for [i = 1:words(methods)] rows('lcm', scene, word(methods, i).',') using e:5 \
                 with points lc rgb word(colours, i) pt (4 + 2 * dashed(word(methods, i))) ps 1.2 \
                 notitle, \
             rows('table', scene, 'CVODE') using e:5 with linespoints lc rgb 'black' pt 5 ps 0.5 \
                 title 'CVODE on physics', \
             NaN with points lc rgb 'black' pt 6 ps 1.2 title 'over LCM'
    }
}
unset multiplot
