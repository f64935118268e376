# Growth of the error of the positions over ten times the length of a training trajectory: median
# and quartiles over the trajectories of each form, from the data of evaluate --plot.
set terminal pngcairo size 900,420 font 'DejaVu Sans,11' background 'white'
set output 'growth.png'
set border 3 linecolor '#555555'
set tics nomirror out textcolor '#222222'
set grid linetype 1 linecolor '#e4e4e4'
set key outside right top noautotitle samplen 2
set logscale y
unset mytics
set format y '10^{%L}'
set xlabel 'time, s'
set ylabel 'relative error of q, %'
set xrange [0:600]
band(name) = name.'/growth.txt'
plot band('free') using 1:3:5 with filledcurves fillcolor '#666666' fillstyle transparent solid 0.25 noborder, \
     '' using 1:4 with lines linewidth 1.2 linecolor '#666666' title 'free (black box)', \
     band('soft') using 1:3:5 with filledcurves fillcolor '#d55e00' fillstyle transparent solid 0.25 noborder, \
     '' using 1:4 with lines linewidth 1.2 linecolor '#d55e00' title 'soft', \
     band('hard') using 1:3:5 with filledcurves fillcolor '#0072b2' fillstyle transparent solid 0.25 noborder, \
     '' using 1:4 with lines linewidth 1.2 linecolor '#0072b2' title 'hard'
