// The hand in Pinocchio: reads its numbers and its states, and answers one line for each command.
//
// Input, all numbers in SI units and in the axes of the palm:
//   fingers, and for each: rotation (9, row by row) and position (3) of the base; four lengths; four
//   bodies (mass, centre on the link's x axis, principal moments about x, y, z)
//   gravity (3)
//   states, and for each: positions, rates, accelerations and torques of all joints
// Commands:
//   TASK CALLS         answers with the nanoseconds that so many calls took
//   show TASK STATE    answers with the results for one state
// with the tasks kinematics, inverse and forward.

#include <chrono>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include <pinocchio/config.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace {

namespace pin = pinocchio;

constexpr int JOINTS = 4;

struct State {
    Eigen::VectorXd q, v, a, tau;
};

double number()
{
    double value = 0.0;
    if (!(std::cin >> value)) {
        std::cerr << "a number is missing\n";
        std::exit(2);
    }
    return value;
}

pin::SE3 read_placement()
{
    Eigen::Matrix3d rotation;
    Eigen::Vector3d position;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) rotation(row, column) = number();
    for (int axis = 0; axis < 3; ++axis) position(axis) = number();
    return pin::SE3(rotation, position);
}

class Hand {
public:
    Hand() : data_(read()), order_(states_.size()) {}

    int run(const std::string& task, long calls)
    {
        using clock = std::chrono::steady_clock;
        const auto begin = clock::now();
        for (long call = 0; call < calls; ++call) {
            const State& state = states_[static_cast<size_t>(call) % order_];
            if (!once(task[0], state)) return 2;
            // The compiler must not know that nobody reads the results.
            asm volatile("" : : "r"(this), "r"(&data_) : "memory");
        }
        const auto time = std::chrono::duration<double, std::nano>(clock::now() - begin);
        std::printf("%.1f\n", time.count());
        std::fflush(stdout);
        return 0;
    }

    int show(const std::string& task, size_t index)
    {
        if (index >= order_ || !once(task[0], states_[index])) return 2;
        switch (task[0]) {
        case 'k':
            for (size_t tip = 0; tip < tips_.size(); ++tip) {
                const pin::SE3& pose = data_.oMf[tips_[tip]];
                print(pose.translation());
                print(pose.rotation());
                print(jacobians_[tip].middleCols(JOINTS * static_cast<Eigen::Index>(tip), JOINTS));
            }
            break;
        case 'i': print(data_.tau); break;
        default: print(data_.ddq); break;
        }
        std::printf("\n");
        std::fflush(stdout);
        return 0;
    }

private:
    bool once(char task, const State& state)
    {
        switch (task) {
        case 'k':
            pin::computeJointJacobians(model_, data_, state.q);
            for (size_t tip = 0; tip < tips_.size(); ++tip) {
                pin::updateFramePlacement(model_, data_, tips_[tip]);
                pin::getFrameJacobian(
                    model_, data_, tips_[tip], pin::LOCAL_WORLD_ALIGNED, jacobians_[tip]);
            }
            return true;
        case 'i': pin::rnea(model_, data_, state.q, state.v, state.a); return true;
        case 'f': pin::aba(model_, data_, state.q, state.v, state.tau, CONVENTION); return true;
        default: return false;
        }
    }

    // Column by column.
    template <typename Matrix>
    static void print(const Matrix& matrix)
    {
        for (Eigen::Index column = 0; column < matrix.cols(); ++column)
            for (Eigen::Index row = 0; row < matrix.rows(); ++row)
                std::printf("%.17g ", matrix(row, column));
    }

    const pin::Model& read()
    {
        const int fingers = static_cast<int>(number());
        for (int finger = 0; finger < fingers; ++finger) {
            pin::SE3 placement = read_placement();
            double lengths[JOINTS];
            for (double& length : lengths) length = number();
            pin::JointIndex parent = 0;
            for (int joint = 0; joint < JOINTS; ++joint) {
                const std::string name = std::to_string(finger) + "." + std::to_string(joint);
                // The joints with a known axis are the fastest that Pinocchio has.
                parent = joint == 0
                    ? model_.addJoint(parent, pin::JointModelRZ(), placement, name)
                    : model_.addJoint(parent, pin::JointModelRY(), placement, name);
                const double mass = number();
                const double center = number();
                const Eigen::Vector3d moments(number_vector());
                const pin::Inertia inertia(
                    mass, Eigen::Vector3d(center, 0, 0), Eigen::Matrix3d(moments.asDiagonal()));
                model_.appendBodyToJoint(parent, inertia, pin::SE3::Identity());
                placement = along(lengths[joint]);
            }
            tips_.push_back(model_.addFrame(
                pin::Frame("tip" + std::to_string(finger), parent, 0, placement, pin::OP_FRAME)));
        }
        model_.gravity.linear(number_vector());
        jacobians_.assign(tips_.size(), pin::Data::Matrix6x::Zero(6, model_.nv));
        states_.resize(static_cast<size_t>(number()));
        for (State& state : states_) {
            for (Eigen::VectorXd* list : {&state.q, &state.v, &state.a, &state.tau}) {
                list->resize(model_.nv);
                for (double& entry : *list) entry = number();
            }
        }
        return model_;
    }

    static pin::SE3 along(double x)
    {
        return pin::SE3(Eigen::Matrix3d::Identity(), Eigen::Vector3d(x, 0, 0));
    }

    static Eigen::Vector3d number_vector()
    {
        const double x = number(), y = number(), z = number();
        return {x, y, z};
    }

    // In the frames of the joints, as the articulated-body algorithm was published.
    static constexpr pin::Convention CONVENTION = pin::Convention::LOCAL;

    pin::Model model_;
    std::vector<pin::FrameIndex> tips_;
    std::vector<pin::Data::Matrix6x> jacobians_;
    std::vector<State> states_;
    pin::Data data_;
    size_t order_;
};

} // namespace

int main()
{
    Hand hand;
    std::printf("%s\n", PINOCCHIO_VERSION);
    std::fflush(stdout);
    std::string task;
    while (std::cin >> task) {
        int status = 0;
        if (task == "show") {
            std::cin >> task;
            status = hand.show(task, static_cast<size_t>(number()));
        } else {
            status = hand.run(task, static_cast<long>(number()));
        }
        if (status != 0) return status;
    }
    return 0;
}
