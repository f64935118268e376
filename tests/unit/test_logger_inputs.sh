#!/bin/sh
# test_logger_inputs.sh PORTMET_TRAIN [short]: what inputs do beside driving one variable. They act later than they were logged, or
# earlier; they move several velocities, as wheels do; and they fill a volume that a piston moves.
. "$(dirname "$0")/../support/setting.sh"
. "$(dirname "$0")/../support/logger_tables.sh"
train=$1 program=$1 short=${2:-}

# noisy NAME COLUMN...: noise of 0.3 % of 1 in these columns of the tables NAME_?.csv.
noisy() {
    name=$1
    shift
    for file in "$folder/${name}"_?.csv; do
        awk -F, -v OFS=, -v columns="$*" -v seed="${#file}" 'BEGIN { srand(seed); n = split(columns, c, " ") }
            NR > 1 { for (i = 1; i <= n; i++) $c[i] += 0.003*(rand() + rand() + rand() + rand() - 2)*sqrt(3) } { print }' \
            "$file" >"$folder/next" && mv "$folder/next" "$file"
    done
}

# shift_input NAME ROWS: what is logged last acts so many rows later.
shift_input() {
    for file in "$folder/$1"_?.csv; do
        awk -F, -v OFS=, -v rows="$2" 'NR == 1 { print; next } { line[NR] = $0; u[NR] = $NF; last = NR }
            END { for (k = 2; k <= last; k++) { at = k + rows; at = at < 2 ? 2 : at > last ? last : at
                  sub(/,[^,]*$/, "", line[k]); print line[k], u[at] } }' "$file" >"$folder/next" && mv "$folder/next" "$file"
    done
}

# A piston of 0.002 m^2 moves the volume of a chamber in another part, into which fluid flows, too.
write piston 8 "v [m/s],x [m],V [L],Q [L/s]" \
    "n = 3; driven = 1; y[1] = rand() - 0.5; y[2] = 0.2*rand() - 0.1; y[3] = 1 + rand()" \
    "a = 9*(y[3] - 1.5) - 50*y[2] - 0.5*y[1]; y[1] += h*a; y[2] += h*y[1]; y[3] += h*(2*u - 2*y[1])"
sed -i 's/Q \[L.s\]/Q [m^3\/s]/' "$folder"/piston_?.csv
for file in "$folder"/piston_?.csv; do
    awk -F, -v OFS=, 'NR > 1 { $5 *= 0.002 } { print }' "$file" >"$folder/next" && mv "$folder/next" "$file"
done
noisy piston 2 3 4
succeed "Q [m^3/s]: an input; flows into V" propose --budget 0 --data "$folder"/piston_?.csv --inputs Q --part rod=v,x \
    --part chamber=V -o "$folder/piston"
succeed "Verdict: good" fit "$folder/piston/training.yaml" -o "$folder/piston/weights"

# A vessel leaks and is filled, and a pressure drives the flow of a line into it. The pressure has a known power, so
# that the inflow, whose power is that of the level times a constant, has none.
write vessel 8 "h [m],Q [L/s],dP [kPa],Qin [L/s]" \
    "n = 3; driven = 1; y[1] = rand() - 0.5; y[2] = 2*rand() - 1; y[3] = 10*rand() - 5" \
    "if (j == 19 && k % 13 == 12) y[3] = 10*rand() - 5
     a = (y[3] - 9.8*y[1] - 0.5*y[2])/2; y[2] += h*a; y[1] += h*(y[2] + u - 0.3*y[1])"
noisy vessel 2 3
succeed "Qin [m^3/s]: an input; moves, with a learned factor, h" propose --budget 0 --data "$folder"/vessel_?.csv --inputs dP,Qin -o "$folder/vessel"
succeed "Verdict: good" fit "$folder/vessel/training.yaml" -o "$folder/vessel/weights"
awk '$1 ~ /gain_Qin_h/ { n = $3 > 0.97 && $3 < 1.03 } END { exit !n }' "$folder/out" ||
    fail "fit: the power of the inflow is that of the level times 9800 N/m^3"

# A body on a runner, held by a spring in the plane, whose velocities turn into each other.
write runner 8 "x [m],y [m],heading [rad],v [m/s],w [rad/s],F [N]" \
    "n = 5; driven = 1; y[3] = 6*rand() - 3; y[4] = 2*rand() - 1; y[5] = 8*rand() - 4" \
    "y[1] += h*y[4]*cos(y[3]); y[2] += h*y[4]*sin(y[3]); y[3] += h*y[5]
     f = -40*(y[1]*cos(y[3]) + y[2]*sin(y[3])); a = (10*u + f - 3*y[4] + 0.2*y[5]*y[5])/2
     b = (-0.2*y[5] - 4*sin(y[3]) - 0.2*y[4]*y[5])/0.5; y[4] += h*a; y[5] += h*b"
succeed "wrote" propose --budget 0 --data "$folder"/runner_?.csv --inputs F -o "$folder/runner"
grep -q "gyration_v_w_by_w" "$folder/runner/training.yaml" || fail "propose: the velocities turn into each other"
[ -n "$short" ] && finish # searches take ten times as long in slow builds

# A motor of speed w turns a weight. Its torque acts 0.04 s later than logged, or was logged 0.02 s late.
for rows in 2 -1; do
    write "motor" 8 "q [rad],w [rad/s],M [N m]" "n = 2; driven = 1; y[1] = 4*rand() - 2; y[2] = 4*rand() - 2" \
        "a = 8*u - 0.5*y[2] - 6*sin(y[1]); y[2] += h*a; y[1] += h*y[2]"
    shift_input motor $rows
    noisy motor 2 3
    succeed "wrote" propose --budget 20 --data "$folder"/motor_?.csv --inputs M -o "$folder/motor$rows"
    delay=$(test $rows = 2 && echo 0.04 || echo -0.02)
    grep -q "hold: previous, delay: $delay}" "$folder/motor$rows/scene.yaml" || fail "propose: expected delay: $delay"
    succeed "Verdict: good" fit "$folder/motor$rows/training.yaml" -o "$folder/motor$rows/weights"
    awk '$1 == "q" || $1 == "w" { n += $2 < 2 } END { exit n != 2 }' "$folder/out" || fail "the motor is not learned"
done

# A current carries entropy from a cold plate to a warm one, so that its direction tells which one cools, and heats both.
write couple 8 "Tc [K],Th [K],I [A]" "n = 2; driven = 1; y[1] = 285 + 20*rand(); y[2] = 295 + 20*rand()" \
    "q = 0.5*(y[2] - y[1]); c = 3*u; y[1] += 0.05*(-0.05*y[1]*c + c*c + q + 0.1*(295 - y[1]))/1.6
     y[2] += 0.05*(0.05*y[2]*c + c*c - q + 2.5*(295 - y[2]))/6"
for file in "$folder"/couple_?.csv; do
    awk -F, -v OFS=, 'NR > 1 { $1 *= 50; $4 *= 3 } { print }' "$file" >"$folder/next" && mv "$folder/next" "$file"
done
noisy couple 2 3
succeed "I [A]: an input; heats, with a learned factor, Tc" propose --budget 0 --data "$folder"/couple_?.csv --inputs I -o "$folder/couple"
succeed "Verdict: good" fit "$folder/couple/training.yaml" -o "$folder/couple/weights"
awk '/carried_I_Tc = /{ sub(",", "", $3); c = $3 } /carried_I_Th = /{ sub(",", "", $3); h = $3 }
    END { r = -c/h; exit !(c < 0 && r > 0.9 && r < 1.15) }' "$folder/out" || fail "fit: as much entropy enters one plate as leaves the other"

# Wheels of two torques move a robot and turn it.
write wheels 8 "heading [rad],v [m/s],w [rad/s],left [N m],right [N m]" \
    "n = 4; driven = 1; y[2] = rand() - 0.5; y[3] = 2*rand() - 1; y[4] = 2*rand() - 1" \
    "if (j == 0 && k % 17 == 0) y[4] = 2*rand() - 1
     a = (10*(u + y[4]) - 3*y[2])/2; b = (2*(u - y[4]) - 0.4*y[3])/0.5; y[2] += h*a; y[3] += h*b; y[1] += h*y[3]"
noisy wheels 2 3 4
succeed "wrote" propose --budget 30 --data "$folder"/wheels_?.csv --inputs left,right -o "$folder/wheels"
grep -q "[*] left: moves all velocities of its part; right: moves all velocities of its part" "$folder/wheels/training.yaml" ||
    fail "propose: both wheels move both velocities"
succeed "Verdict: good" fit "$folder/wheels/training.yaml" -o "$folder/wheels/weights"
[ "$short" != short ] || finish
# Two pumps fill four tanks, each of them two; the upper ones run into the lower ones.
write pumps 8 "a [m],b [m],c [m],d [m],q [m^3/s],p [m^3/s]" \
    "n = 5; driven = 2; for (i = 1; i < 5; i++) y[i] = 0.3 + rand(); y[5] = 2*rand()" \
    "if (j == 0 && k % 11 == 0) y[5] = 2*rand()
     for (i = 1; i < 5; i++) o[i] = 2*sqrt(y[i] > 0 ? y[i] : 0)
     y[1] += h*(o[3] - o[1] + 3*u); y[2] += h*(o[4] - o[2] + 2*y[5])
     y[3] += h*(1.2*y[5] - o[3]); y[4] += h*(2*u - o[4])"
noisy pumps 2 3 4 5
succeed "q [m^3/s]: an input" propose --budget 20 --data "$folder"/pumps_?.csv --inputs p,q -o "$folder/pumps"
[ "$(grep -cE "^[pq] .*(moves, with a learned factor, [abcd]; drives|drives [abcd]; moves, with a learned factor)" "$folder/out")" = 2 ] ||
    fail "propose: each pump fills two tanks"
succeed "Verdict: good" fit "$folder/pumps/training.yaml" -o "$folder/pumps/weights"

# A load swings from a trolley that is pushed: they share an inertia, which depends on the angle.
write crane 8 "x [m],angle [rad],v [m/s],w [rad/s],F [N]" \
    "n = 4; driven = 1; y[1] = rand() - 0.5; y[2] = 2*rand() - 1" \
    "s = sin(y[2]); c = cos(y[2]); r = 40*u - 4*y[3] + 0.96*y[4]*y[4]*s; t = -9.42*s - 0.03*y[4]; D = 3.2256 - 0.9216*c*c
     a = (0.768*r - 0.96*c*t)/D; b = (4.2*t - 0.96*c*r)/D
     y[3] += h*a; y[4] += h*b; y[1] += h*y[3]; y[2] += h*y[4]"
noisy crane 2 3 4 5
succeed "wrote" propose --budget 30 --data "$folder"/crane_?.csv --inputs F -o "$folder/crane"
awk '/misses the validation part by/ { for (i = 1; i < NF; i++) if ($i == "by") small = $(i + 1) < 0.5 } END { exit !small }' \
    "$folder/out" || fail "propose: expected an error below 0.5 %"
succeed "Verdict: good" fit "$folder/crane/training.yaml" -o "$folder/crane/weights"
finish
