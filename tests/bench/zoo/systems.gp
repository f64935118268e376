# Draws the share of systems whose error is below a value: -e "table='systems.csv'" -e "picture='systems.png'"
set terminal pngcairo size 900,500 font "sans,11"
set output picture
set datafile separator ","
set key left top
set logscale x
set xrange [1e-4:1e3]
set yrange [0:100]
set grid
set xlabel "error of a system, % of the deviation (median over test trajectories and groups)"
set ylabel "share of systems below, %"
stats table using "number" nooutput
n = STATS_records
# An error that is not finite, or missing, lies beyond the right edge.
error(k) = valid(k) ? (column(k) < 1e4 ? column(k) : 1e4) : 1e4
plot table using (error("error")):(100.0/n) smooth cumulative with steps lw 2 title "proposal and fit", \
     table using (error("worst")):(100.0/n) smooth cumulative with steps lw 2 title "proposal and fit, worst group", \
     table using (error("black_box")):(100.0/n) smooth cumulative with steps lw 2 dt 2 title "black box of equal time"
