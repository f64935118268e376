#!/bin/sh
# test_logger_turns.sh PORTMET_TRAIN [short]: tables in which velocities turn: a robot on wheels, a flywheel with a crank, a
# rigid body, a charge in a magnetic field, and a current that carries entropy; a piston, two carts on springs, and a reaction. Proposals
# find how, and fits to some of them are good. `short` fits the robot alone.
. "$(dirname "$0")/../support/setting.sh"
. "$(dirname "$0")/../support/logger_tables.sh"
train=$1
short=${2:-}
program=$train

write robot 6 "x [m],y [m],heading [rad],v [m/s],w [rad/s],F [N]" \
    "n = 5; driven = 1; y[3] = 6*rand() - 3; y[4] = 2*rand() - 1; y[5] = 8*rand() - 4" \
    "y[1] += h*y[4]*cos(y[3]); y[2] += h*y[4]*sin(y[3]); y[3] += h*y[5]
     a = (10*u - 3*y[4] + 0.6*y[5]*y[5])/2; b = (-0.2*y[5] - 0.6*y[4]*y[5])/0.5; y[4] += h*a; y[5] += h*b"
succeed "x [m]: a position, moved as angles tell by v" propose --budget 0 --data "$folder"/robot_?.csv --inputs F \
    -o "$folder/robot"
grep -q 'x, v, "1.0\*cos(1\*heading)"' "$folder/robot/training.yaml" || fail "propose: expected the cosine of the heading"
grep -q "gyration_v_w_by_w" "$folder/robot/training.yaml" || fail "propose: the velocities turn into each other"
sed -i 's/iterations: [0-9]*/iterations: 30/' "$folder/robot/training.yaml"
succeed "Verdict: good" fit "$folder/robot/training.yaml" -o "$folder/robot/weights"
# A search shows its progress on a terminal, and only there.
script -qec "$train propose --budget 4 --data $folder/robot_?.csv --inputs F -o $folder/shown" /dev/null >"$folder/out" 2>"$folder/err" </dev/null ||
    fail "propose --budget 4 on a terminal"
tr '\r' '\n' <"$folder/out" | grep -qE '^hypotheses, s \[[# ]*\] [0-9]+/4 .*[0-9] hypothes[ei]s tried, best error [0-9.e-]+ %' ||
    fail "propose: expected a bar of progress on a terminal"
succeed "wrote" propose --budget 1 --data "$folder"/robot_?.csv --inputs F -o "$folder/shown"
[ -n "$short" ] && finish

write crank 6 "angle [rad],n [rad/s],x [m],v [m/s]" \
    "n = 4; y[1] = 6*rand() - 3; y[2] = 8*rand() - 4; y[3] = 0.1*rand(); y[4] = rand() - 0.5" \
    "a = -(0.3*sin(y[1])*40*y[3] + 0.02*y[2])/0.1; b = (40*y[3] - 0.3*y[4])/0.5
     y[1] += h*y[2]; y[3] += h*(0.3*sin(y[1])*y[2] - y[4]); y[2] += h*a; y[4] += h*b"
succeed "x [m]: a position, moved as angles tell by n and v" propose --budget 0 --data "$folder"/crank_?.csv \
    --part wheel=angle,n --part slider=x,v --port wheel,slider -o "$folder/crank"
grep -q 'b.x, a.n, "0.1\*guide_x_n_[0-9]*\*sin(1\*a.angle)"' "$folder/crank/training.yaml" || fail "propose: expected a crank"

write body 6 "w1 [rad/s],w2 [rad/s],w3 [rad/s]" \
    "n = 3; for (j = 1; j <= 3; j++) y[j] = 6*rand() - 3" \
    "a = -y[2]*y[3] - 0.1*y[1]; b = 0.75*y[1]*y[3] - 0.1*y[2]; c = 0.2*y[1]*y[2] - 0.1*y[3]; y[1] += h*a; y[2] += h*b; y[3] += h*c"
succeed "wrote" propose --budget 0 --data "$folder"/body_?.csv -o "$folder/body"
grep -q "gyration_w1_w2_by_w3" "$folder/body/training.yaml" || fail "propose: a rigid body turns"
sed -i 's/iterations: [0-9]*/iterations: 30/' "$folder/body/training.yaml"
succeed "Verdict: good" fit "$folder/body/training.yaml" -o "$folder/body/weights"

write field 6 "x [m],y [m],vx [m/s],vy [m/s]" \
    "n = 4; for (j = 1; j <= 4; j++) y[j] = 2*rand() - 1; y[1] += 2" \
    "r = sqrt(y[1]^2 + y[2]^2 + 0.01); f = 4*(1 - 1/r); a = -f*y[1] + 2*y[4] - 0.1*y[3]; b = -f*y[2] - 2*y[3] - 0.1*y[4]
     y[1] += h*y[3]; y[2] += h*y[4]; y[3] += h*a; y[4] += h*b"
succeed "wrote" propose --budget 0 --data "$folder"/field_?.csv -o "$folder/field"
grep -q "vx, vy, .*circling_vx_vy" "$folder/field/training.yaml" || fail "propose: expected a magnetic field"
grep -q "radius2_x" "$folder/field/training.yaml" || fail "propose: expected an energy of the distance"

write couple 6 "i [A],hot [K],cold [K],P [W]" \
    "n = 3; driven = 1; y[1] = rand() - 0.5; y[2] = 300 + 20*rand(); y[3] = 290 + 20*rand()" \
    "a = (0.05*(y[2] - y[3]) - 0.3*y[1])/0.1; b = (-0.05*y[1]*y[2] + 0.3*y[1]*y[1] - 0.5*(y[2] - y[3]) + u)/3
     c = (0.05*y[1]*y[3] + 0.5*(y[2] - y[3]))/4; y[1] += h*a; y[2] += h*b; y[3] += h*c"
succeed "i [A]: a co-energy, which carries entropy between hot and cold" propose --budget 0 --data "$folder"/couple_?.csv \
    --inputs P --part block=i,hot --part sink=cold -o "$folder/couple"

# A valve opens between two pressures. A flow enters a vessel with the temperature of its inlet, and a wall takes up the
# more heat the more flows.
write valve 6 "p [bar],q [bar],opening [1]" \
    "n = 2; driven = 2; y[1] = 80 + 40*rand(); y[2] = 20 + 20*rand()" \
    "o = 0.2 + u; d = y[1] - y[2]; f = 6*o*d/sqrt(sqrt(d*d + 0.01)); a = 40 - f/4 - 0.2*y[1]; b = f - 2*y[2]; y[1] += h*a; y[2] += h*b"
succeed "is a throttle between p and q" propose --budget 0 --data "$folder"/valve_?.csv --inputs opening \
    -o "$folder/valve"
write inlet 6 "T [K],wall [K],hot [K],flow [L/min]" \
    "n = 3; driven = 2; y[1] = 300 + 20*rand(); y[2] = 290 + 20*rand(); y[3] = 330" \
    "if (j == 0 && k % 20 == 0) y[3] = 320 + 40*rand()
     c = 4*(0.1 + u)*(y[1] - y[2]); a = 6*u*(y[3] - y[1]) - c; b = c - 2*(y[2] - 285); y[1] += h*a; y[2] += h*b"
succeed "cools T; " propose --budget 0 --data "$folder"/inlet_?.csv --inputs flow,hot -o "$folder/inlet"
grep -q 's: {unit: J/K, dE: \["hot"\], hold: previous, dS: \[1\]}' "$folder/inlet/scene.yaml" || fail "propose: the flow enters with hot"
grep -q "conductance_flow_T_wall" "$folder/inlet/training.yaml" || fail "propose: the flow sets the conductance of the wall"
# A valve opens what falls from one level into the next.
write tanks 8 "h1 [m],h2 [m],valve [1]" "n = 2; driven = 2; y[1] = 1 + rand(); y[2] = 0.5 + rand()" \
    "f = 0.3*(0.2 + 0.8*u)*sqrt(y[1]); y[1] -= h*f/0.5; y[2] += h*(f - 0.2*sqrt(y[2]))/0.3"
for i in 1 2 3 4 5 6 7 8; do
    awk -F, -v OFS=, -v seed=$i 'BEGIN { srand(seed) } NR > 1 { for (c = 2; c < 4; c++) $c += 0.002*(rand() - 0.5) } 1' "$folder/tanks_$i.csv" >"$folder/noisy_$i.csv"
done
succeed "opens the outflow of h1" propose --budget 8 --data "$folder"/noisy_?.csv --inputs valve -o "$folder/tanks"

# An input that looks smooth is held between samples, as a trial shows, or it is not.
write held 8 "v [m/s],F [N]" "n = 2; p = 6*rand(); y[1] = 2*rand() - 1; y[2] = sin(p)" \
    "y[1] += h*(10*y[2] - 2*y[1])/0.8; if (j == 19) y[2] = sin(0.3*(k + 1) + p)"
write smooth 8 "v [m/s],F [N]" "n = 2; p = 6*rand(); y[1] = 2*rand() - 1; y[2] = sin(p)" \
    "y[1] += h*(10*sin(0.3*(k + (j + 0.5)/20) + p) - 2*y[1])/0.8; if (j == 19) y[2] = sin(0.3*(k + 1) + p)"
for name in held smooth; do
    for i in 1 2 3 4 5 6 7 8; do
        awk -F, -v OFS=, -v seed=$i 'BEGIN { srand(seed) } NR > 1 { $2 += 0.04*(rand() - 0.5) } 1' "$folder/${name}_$i.csv" >"$folder/noisy_$i.csv"
    done
    succeed "wrote" propose --budget 8 --data "$folder"/noisy_?.csv --inputs F -o "$folder/$name"
    hold=$(test $name = held && echo previous || echo smooth)
    grep -q "hold: $hold" "$folder/$name/scene.yaml" || fail "propose: expected hold: $hold"
done

# A damper whose resistance is three times as large in one direction.
write damper 6 "v [m/s],F [N]" "n = 1; driven = 1; y[1] = 2*rand() - 1" "y[1] += h*(10*u - (y[1] > 0 ? 6 : 2)*y[1])/0.8"
succeed "wrote" propose --budget 0 --data "$folder"/damper_?.csv --inputs F -o "$folder/damper"
succeed "Verdict: good" fit "$folder/damper/training.yaml" -o "$folder/damper/weights"
awk '/rollouts have/ { some = 1; if (!($9 < 0.2)) bad = 1 } END { exit !some || bad }' "$folder/out" || fail "the damper is not learned"

# A user knows how many variables nobody measures.
succeed "v_behind" propose --budget 4 --hidden 1 --data "$folder"/damper_?.csv --inputs F -o "$folder/known"
[ "$(grep -c "nobody measures it" "$folder/known/scene.yaml")" = 1 ] || fail "propose: expected one hidden variable"
succeed "wrote" propose --budget 4 --hidden 0 --data "$folder"/damper_?.csv --inputs F -o "$folder/none"
grep -q "nobody measures it" "$folder/none/scene.yaml" && fail "propose: expected no hidden variable"
grep -q "with many bends" "$folder/none/training.yaml" || fail "propose: expected trials without hidden variables"

# A piston moves the volume of a chamber in another part, whose gas is warmed by this.
write gas 6 "v [m/s],x [m],V [L],T [K]" \
    "n = 4; y[1] = rand() - 0.5; y[2] = 0.2*rand() - 0.1; y[3] = 1 + rand(); y[4] = 290 + 20*rand()" \
    "p = y[4]/300/y[3]; a = 20*(p - 0.7) - 50*y[2] - 0.5*y[1]; y[4] -= h*0.4*y[4]/y[3]*2*y[1]; y[1] += h*a; y[2] += h*y[1]; y[3] += h*2*y[1]"
succeed "V [m^3]: a position, whose rate is" propose --budget 0 --data "$folder"/gas_?.csv --part rod=v,x --part gas=V,T -o "$folder/gas"
grep -q "a.v, b.V, " "$folder/gas/training.yaml" || fail "propose: expected a piston between the parts"

# A spring between two carts: a port stores no energy, so that the distance of both is what a part needs.
write carts 6 "x1 [m],v1 [m/s],x2 [m],v2 [m/s]" \
    "n = 4; for (j = 1; j <= 4; j++) y[j] = 0.4*rand() - 0.2" \
    "f = 30*(y[3] - y[1] - 0.1); a = (f - 20*y[1] - 0.3*y[2])/0.5; b = (-f - 0.2*y[4])/0.8
     x = y[1] + h/2*y[2]; z = y[3] + h/2*y[4]; v = y[2] + h/2*a; w = y[4] + h/2*b
     f = 30*(z - x - 0.1); a = (f - 20*x - 0.3*v)/0.5; b = (-f - 0.2*w)/0.8
     y[1] += h*v; y[3] += h*w; y[2] += h*a; y[4] += h*b"
succeed "x2 [m]: a position, measured from x1 of left since a spring is between them, whose rate is v2 -1 v1" \
    propose --budget 0 --data "$folder"/carts_?.csv --part left=x1,v1 --part right=x2,v2 -o "$folder/carts"
grep -q 'x2: {unit: "m", columns: \["x2"\], relative_to: left.x1}' "$folder/carts/scene.yaml" || fail "propose: expected a distance"
grep -q "a.v1, b.x2, 1.0" "$folder/carts/training.yaml" || fail "propose: expected a spring at the port"
succeed "Verdict: good" fit "$folder/carts/training.yaml" -o "$folder/carts/weights"
succeed "steps in violation                    0 of" evaluate "$folder/carts/scene.yaml" --weights "$folder/carts/weights" --data "$folder/carts_1.csv"

# If walls hold both carts, the distance is needed beside the positions.
write walls 6 "x1 [m],v1 [m/s],x2 [m],v2 [m/s]" \
    "n = 4; for (j = 1; j <= 4; j++) y[j] = 0.4*rand() - 0.2" \
    "f = 30*(y[3] - y[1]); a = (f - 20*y[1] - 0.3*y[2])/0.5; b = (-f - 25*y[3] - 0.2*y[4])/0.8
     y[2] += h*a; y[4] += h*b; y[1] += h*y[2]; y[3] += h*y[4]"
succeed "make both one part, or give the distance x1 - x2 as a further column" propose --budget 0 --data "$folder"/walls_?.csv \
    --part left=x1,v1 --part right=x2,v2 -o "$folder/walls"

# A belt between a shaft and a sledge: a spring of shaft and sledge with a lever, and a friction of its own.
write belt 6 "angle [rad],n [rad/s],x [m],v [m/s],M [N m]" \
    "n = 4; driven = 1; y[1] = 4*rand() - 2; y[3] = 0.05*y[1]" \
    "f = 900*(0.05*y[1] - y[3]) + 6*(0.05*y[2] - y[4]); a = (0.4*u - 0.003*y[2] - 0.05*f)/0.002; b = (f - 2*y[4])/0.7
     p = y[1] + h/2*y[2]; q = y[2] + h/2*a; r = y[3] + h/2*y[4]; s = y[4] + h/2*b
     f = 900*(0.05*p - r) + 6*(0.05*q - s); a = (0.4*u - 0.003*q - 0.05*f)/0.002; b = (f - 2*s)/0.7
     y[1] += h*q; y[2] += h*a; y[3] += h*s; y[4] += h*b"
succeed "M [N m]: an input; drives n" propose --budget 0 --data "$folder"/belt_?.csv --inputs M -o "$folder/belt"
grep -qE "lever_angle_x: {learned: 0.0(49|50)" "$folder/belt/training.yaml" || fail "propose: expected a lever of 0.05 m"
grep -q '{"a.n": "1\*lever_angle_x", "a.v": -1}' "$folder/belt/training.yaml" || fail "propose: expected the friction of the belt"
sed -i 's/iterations: [0-9]*/iterations: 30/' "$folder/belt/training.yaml"
succeed "Verdict: good" fit "$folder/belt/training.yaml" -o "$folder/belt/weights"

# An arm of two links in the plane of gravity, with noise: its inertia depends on the elbow, and gravity on both angles.
write arm 8 "q1 [rad],w1 [rad/s],q2 [rad],w2 [rad/s],M [N m]" \
    "n = 4; driven = 1; for (j = 1; j <= 4; j++) y[j] = 2*rand() - 1" \
    "c = 0.06*cos(y[3]); e = 0.06*sin(y[3]); m = 0.3 + 2*c; d = 0.05 + c; g = 1.5*sin(y[1] + y[3])
     t = 4*u - 0.4*y[2] + e*(2*y[2]*y[4] + y[4]*y[4]) - 4*sin(y[1]) - g; o = -0.2*y[4] - e*y[2]*y[2] - g; z = m*0.1 - d*d
     y[2] += h*(0.1*t - d*o)/z; y[4] += h*(m*o - d*t)/z; y[1] += h*y[2]; y[3] += h*y[4]"
for i in 1 2 3 4 5 6 7 8; do
    awk -F, -v seed=$i 'BEGIN { OFS = ","; srand(seed) } NR > 1 {
        for (c = 2; c <= 5; c++) $c += (c % 2 ? 0.01 : 1e-3)*(rand() + rand() + rand() + rand() - 2)*sqrt(3) } { print }' \
        "$folder/arm_$i.csv" >"$folder/links_$i.csv"
done
succeed "w1 [rad/s]: a co-energy; noise" propose --budget 0 --data "$folder"/links_?.csv --inputs M -o "$folder/arm"
grep -q "w1_w1_w1_q2" "$folder/arm/training.yaml" || fail "propose: expected an inertia that depends on the elbow"
succeed "Verdict: good" fit "$folder/arm/training.yaml" -o "$folder/arm/weights"

# A reaction in a solvent, whose product is not there at first; noise of 1e-3 mol and 0.05 K. Its equilibrium depends on the
# temperature as its heat says.
write reaction 12 "A [mol],B [mol],T [K]" \
    "n = 3; y[1] = 0.5 + 1.5*rand(); y[2] = 0; y[3] = 295 + 30*rand()" \
    "r = 8*exp(3000*(1/310 - 1/y[3]))*(y[1] - y[2]/(3*exp(360.8*(1/y[3] - 1/310))))
     y[1] -= h*r; y[2] += h*r; y[3] += h*(6*r - 3*(y[3] - 300))"
for i in 1 2 3 4 5 6 7 8 9 10 11 12; do
    awk -F, -v seed=$i 'BEGIN { OFS = ","; srand(seed) } NR > 1 {
        for (c = 2; c <= 4; c++) $c += (c < 4 ? 1e-3 : 0.05)*(rand() + rand() + rand() + rand() - 2)*sqrt(3) } { print }' \
        "$folder/reaction_$i.csv" >"$folder/noisy_$i.csv"
done
succeed "B [mol]: an amount; noise" propose --budget 0 --data "$folder"/noisy_*.csv -o "$folder/reaction"
grep -q '{"A": 1, "B": -1}, T, ' "$folder/reaction/training.yaml" || fail "propose: expected a reaction"
succeed "Verdict: good" fit "$folder/reaction/training.yaml" -o "$folder/reaction/weights"

finish
