# The changes that spin an aggregate up by increments:
#   awk -v cohesion=N -v increment=RAD/S -v interval=S -v increments=COUNT -f changes.awk
BEGIN {
    kind = cohesion > 0 ? sprintf("IQS_WET_DS_CLB(cohesion: %.9e, range: 0.2, dynamic_friction: 0.4, static_friction: 0.4)", cohesion) \
                        : "IQS_CLB(friction: 0.4)"
    print "// The aggregate at rest, with cohesion " cohesion " N, spun up by " increment " rad/s every " interval " s."
    print "("
    print "    bodies: [(keep: Largest, stop: RigidMotion, centre: (0.0, 0.0, 0.0))],"
    print "    laws: [(name: \"spun0\", kind: " kind ")],"
    print "    contacts: [(between: (\"BLUEx\", \"BLUEx\"), law: \"spun0\")],"
    print "    compute: ("
    printf "        dt: 2.0, end_time: %.9e, self_gravity: true, output_every: %d,\n", interval * (increments + 1), interval / 2
    print "        events: ["
    for (k = 1; k <= increments; k++)
        printf "            (time: %.9e, action: AddSpin((0.0, 0.0, %.9e))),\n", k * interval, increment
    print "        ],"
    print "    ),"
    print ")"
}
