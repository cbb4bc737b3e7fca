// A vehicle that a heaving foil drives forward: the scene heaves the foil's front edge, the vehicle moves it along x.
//
//   surge SCENE [seconds]
//
// Both exchange what they know once a step, at a fixed rate, as a control loop does: the vehicle gives its position, speed and
// acceleration now, and takes the foil's force over its step as the line through the last two. Nothing damps the foil's
// stretching, whose slowest mode has a period of 3 ms: a loop at 4 kHz resolves it, one at 1 kHz feeds it until the foil folds.
// Prints time, x and speed every half second, and at the end what the coupling lost of the momentum, relative to that which
// drag took.

#include <caudal.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>

/// A tail by names of variables; errors are exceptions.
class Tail {
public:
    explicit Tail(const std::string &scene)
    {
        caudal_simulation *simulation = nullptr;
        must(caudal_load(scene.c_str(), nullptr, 0, &simulation));
        simulation_.reset(simulation);
    }

    double time() const { return caudal_time(simulation_.get()); }
    void step(double h) { must(caudal_do_step(simulation_.get(), h)); }

    std::size_t find(const char *name) const
    {
        std::size_t index = 0;
        must(caudal_find(simulation_.get(), name, &index));
        return index;
    }

    double get(std::size_t variable) const
    {
        double value = 0.0;
        must(caudal_get(simulation_.get(), variable, &value, 1));
        return value;
    }

    void set(std::size_t variable, double value) { must(caudal_set(simulation_.get(), variable, &value, 1)); }

private:
    static void must(caudal_status status)
    {
        if (status != CAUDAL_OK)
            throw std::runtime_error(caudal_message());
    }

    struct Free {
        void operator()(caudal_simulation *simulation) const { caudal_free(simulation); }
    };
    std::unique_ptr<caudal_simulation, Free> simulation_;
};

/// m dv/dt = force - drag v, exactly, under a force that is linear over the step.
struct Vehicle {
    static constexpr double mass = 0.5, drag = 0.2; // kg, N s/m
    double x = 0.0, v = 0.0;

    double acceleration(double force) const { return (force - drag * v) / mass; }

    void step(double first, double last, double h)
    {
        const double k = drag / mass, slope = (last - first) / h;
        const double steady = (first - slope / k) / drag; // v = steady + slope t / drag + rest e^(-kt)
        const double rest = v - steady, decay = std::exp(-k * h);
        x += steady * h + 0.5 * slope * h * h / drag + rest * (1.0 - decay) / k;
        v = steady + slope * h / drag + rest * decay;
    }
};

int main(int argc, char **argv)
try {
    if (argc < 2) {
        std::fprintf(stderr, "usage: %s SCENE [seconds]\n", argv[0]);
        return 2;
    }
    const double h = 2.5e-4, end = argc > 2 ? std::atof(argv[2]) : 3.0;
    Tail foil(argv[1]);
    const auto x = foil.find("head_x_m"), v = foil.find("head_vx_m_s"), a = foil.find("head_ax_m_s2");
    const auto force = foil.find("head_force_x_n"), impulse = foil.find("head_impulse_x_n_s");

    Vehicle vehicle;
    double now = foil.get(force), before = now;
    for (long step = 1; foil.time() < end - 0.5 * h; ++step) {
        foil.set(x, vehicle.x);
        foil.set(v, vehicle.v);
        foil.set(a, vehicle.acceleration(now));
        foil.step(h);
        vehicle.step(now, 2.0 * now - before, h);
        before = now;
        now = foil.get(force);
        if (step % 2000 == 0)
            std::printf("%.17g %.17g %.17g\n", foil.time(), vehicle.x, vehicle.v);
    }
    const double taken = Vehicle::drag * vehicle.x, gained = Vehicle::mass * vehicle.v;
    std::printf("momentum lost: %.3g\n", std::abs(gained + taken + foil.get(impulse)) / std::abs(taken));
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
