/* The limit of a sweep: forcebound/lab/one_axis.py in C, for the certified law, the elastic wall and
 * punctual ticks. Same order of operations: with -ffp-contract=off it gives the same bits.
 */
#include <math.h>
#include <stdint.h>

enum { ANCHOR_SAMPLES = 8, COLUMNS = 9 }; /* bounding/sample.py, TRACE */

/* In the order in which sweep.py gives them. */
struct rig {
    double mass, damping, friction, hand_stiffness, hand_damping, hand_mass, substep, resolution,
        saturation, largest_speed, cutoff, wall_stiffness, wall_position;
    /* DeviceConstants, bounding/sample.py */
    double law_damping, law_friction, r, period, hold_limit, axes, path_friction, start_price,
        energy_cap;
};

struct body { double x, v, work, muscle, target; int64_t time_ns; };

static inline double smaller(double a, double b) { return b < a ? b : a; }
static inline double larger(double a, double b) { return b > a ? b : a; }

static inline double clear_square(double reading, double anchor, double r)
{
    double clear = larger(fabs(reading - anchor) - 2.0 * r, 0.0);
    return clear * clear;
}

static inline double quantise(double x, double resolution)
{
    return resolution <= 0.0 ? x : floor(x / resolution + 0.5) * resolution;
}

/* devices/plant.py, with rigid friction */
static inline void move(struct body *b, const struct rig *p, int64_t time_ns, double end,
                        double force)
{
    if (time_ns <= b->time_ns)
        return;
    double duration = (time_ns - b->time_ns) * 1e-9;
    int64_t steps = (int64_t)ceil(duration / p->substep - 1e-9);
    steps = steps < 1 ? 1 : steps;
    double h = duration / steps, velocity = (end - b->target) / duration;
    double inertia = 2.0 * p->mass / h;
    double impedance = inertia + p->damping + p->hand_damping + 0.5 * h * p->hand_stiffness;
    double x = b->x, v = b->v, work = b->work, muscle = 0.0;
    for (int64_t i = 0; i < steps; i++) {
        double middle = b->target + velocity * (i + 0.5) * h, mean = 0.0;
        double drive = inertia * v + p->hand_stiffness * (middle - x);
        drive = drive + p->hand_damping * velocity - force;
        if (drive > p->friction)
            mean = (drive - p->friction) / impedance;
        else if (drive < -p->friction)
            mean = (drive + p->friction) / impedance;
        double dx = h * mean;
        muscle = p->hand_stiffness * (middle - x - 0.5 * dx);
        muscle += p->hand_damping * (velocity - mean);
        x += dx;
        work += muscle * dx;
        v = 2.0 * mean - v;
        if (mean > 0.0)
            v = larger(v, 0.0);
        else
            v = mean < 0.0 ? smaller(v, 0.0) : 0.0;
    }
    *b = (struct body){x, v, work, muscle, end, time_ns};
}

int64_t run(int64_t ticks, const struct rig *p, const int64_t *restrict instants_ns,
            const double *restrict targets, const int64_t *restrict answered,
            const double *restrict engagement, double *restrict answers, double *restrict trace)
{
    struct body b = {targets[0], 0.0, 0.0, 0.0, targets[0], instants_ns[0]};
    double sample = quantise(b.x, p->resolution), velocity = 0.0, r = p->r;
    double before = sample, force = 0.0, mean = 0.0, play = sample, way = 0.0, path = 0.0;
    double older = sample, younger = sample, loss = 0.0, between = 0.0;
    double older_age = 0.0, younger_age = 0.0, state = -p->start_price, energy = state;
    int samples = 0;
    int64_t sampled_ns = instants_ns[0], written_ns = instants_ns[0];
    for (int64_t k = 0; k < ticks; k++) {
        /* The sample. */
        int64_t sample_ns = instants_ns[2 * k], write_ns = instants_ns[2 * k + 1];
        move(&b, p, sample_ns, targets[2 * k], force);
        double reading = quantise(b.x, p->resolution), dt = (sample_ns - sampled_ns) * 1e-9;
        if (k > 0) {
            double angle = 2.0 * M_PI * p->cutoff * dt;
            velocity += angle / (1.0 + angle) * ((reading - sample) / dt - velocity);
        }
        sample = reading;
        sampled_ns = sample_ns;
        answers[k] = p->wall_stiffness * larger(sample - p->wall_position, 0.0);
        /* The write. */
        move(&b, p, write_ns, targets[2 * k + 1], force);
        reading = quantise(b.x, p->resolution);
        double share = engagement[k];
        double commanded = answered[k] >= 0 ? share * answers[answered[k]] : 0.0;
        double demand = commanded, limit = 0.0;
        if (fabs(demand) > share * p->saturation)
            demand = share * p->saturation / fabs(demand) * demand;
        if (k == 0) {
            before = play = older = younger = reading;
        } else { /* bounding/one_axis.py */
            dt = (write_ns - written_ns) / 1e9;
            if (fabs(reading - before) > p->largest_speed * dt + p->resolution)
                return k;
            double position = larger(reading - r, smaller(reading + r, play));
            double moved = fabs(position - play), held = force;
            way += moved;
            older_age += dt;
            younger_age += dt;
            double long_way = sqrt(way * way), now = loss;
            now += p->law_damping * clear_square(reading, before, r) / dt;
            now = larger(now, p->law_damping * clear_square(reading, older, r) / older_age);
            now = larger(now, between
                + p->law_damping * clear_square(reading, younger, r) / younger_age);
            double slid = p->law_friction * moved + p->path_friction * (long_way - path);
            double price = r * fabs(held);
            /* certified.py: limit, energy */
            double ledger = state - r * fabs(held - mean);
            ledger += now - loss + slid + held * (reading - before);
            state = smaller(ledger, p->energy_cap + price);
            energy = state - price;
            /* hold_cost.py: rigid_force */
            limit = p->law_friction
                + 2.0 * sqrt(p->law_damping / p->hold_limit * larger(energy, 0.0));
            limit = smaller(limit, p->saturation);
            force = smaller(larger(demand, -limit), limit);
            before = reading;
            mean = held;
            play = position;
            path = long_way;
            loss = now;
            if (++samples == ANCHOR_SAMPLES) {
                loss = between = now - between;
                older = younger;
                younger = reading;
                older_age = younger_age;
                younger_age = 0.0;
                samples = 0;
            }
        }
        written_ns = write_ns;
        double row[COLUMNS] = {reading, commanded, force, limit, energy,
                               b.work - 0.5 * p->hand_mass * b.v * b.v, b.x, b.muscle, velocity};
        for (int column = 0; column < COLUMNS; column++)
            trace[k * COLUMNS + column] = row[column];
    }
    return ticks;
}
