// Measures Eigen and CHOLMOD on the linear system that `ours.rs` has written to FOLDER, and Eigen's assembly on the element
// triplets there. One JSON object a line, as `ours.rs` prints them.
//
//     peers LIBRARY NAME PARTICLES FOLDER THREADS LARGEST_FACTOR_FLOPS
#include <Eigen/Sparse>
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <sstream>
#include <suitesparse/cholmod.h>
#include <vector>

using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;
using Triplet = Eigen::Triplet<double, int>;

static std::string scene;
static long particles;
static int threads;

// Processor time where one thread works, the clock where several do: as in `ours.rs`.
static double now() {
    if (threads == 1) {
        timespec time;
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
        return time.tv_sec + 1e-9 * time.tv_nsec;
    }
    using namespace std::chrono;
    return duration<double>(steady_clock::now().time_since_epoch()).count();
}

static void line(const char *library, const char *stage, double seconds, const std::string &more = "") {
    std::printf("{\"scene\": \"%s\", \"particles\": %ld, \"library\": \"%s\", \"threads\": %d, \"stage\": \"%s\", \"ms\": %.6g%s}\n",
                scene.c_str(), particles, library, threads, stage, 1e3 * seconds, more.c_str());
    std::fflush(stdout);
}

// The median of repeats; the first call, which takes new memory from the system, counts only where it takes long.
template <class Kernel> static double median(Kernel kernel) {
    std::vector<double> times;
    double spent = 0, first = 0;
    do {
        double start = now();
        kernel();
        double time = now() - start;
        if (first == 0 && time < 10.0) first = time;
        else times.push_back(time), spent += time;
    } while (times.empty() || (first > 0 && times.size() < 3) || (spent < 1.0 && times.size() < 21));
    std::nth_element(times.begin(), times.begin() + times.size() / 2, times.end());
    return times[times.size() / 2];
}

template <class Value> static void read(std::ifstream &file, Value *values, size_t count) {
    file.read(reinterpret_cast<char *>(values), count * sizeof(Value));
}

static Matrix read_lower(const std::string &folder) {
    std::ifstream file(folder + "/a.bin", std::ios::binary);
    std::uint64_t sizes[2];
    read(file, sizes, 2);
    Matrix lower(sizes[0], sizes[0]);
    lower.resizeNonZeros(sizes[1]);
    read(file, lower.outerIndexPtr(), sizes[0] + 1);
    read(file, lower.innerIndexPtr(), sizes[1]);
    read(file, lower.valuePtr(), sizes[1]);
    return lower;
}

static Eigen::VectorXd read_vector(const std::string &folder, long rows) {
    std::ifstream file(folder + "/b.bin", std::ios::binary);
    Eigen::VectorXd vector(rows);
    read(file, vector.data(), rows);
    return vector;
}

// What a program without a slot map does in every step: all element triplets, then setFromTriplets.
static void eigen_assembly(const std::string &folder, const Matrix &lower) {
    std::ifstream file(folder + "/triplets.bin", std::ios::binary);
    struct Element { int row, column; double value; };
    std::vector<Element> elements;
    Element element;
    while (file.read(reinterpret_cast<char *>(&element), sizeof element)) elements.push_back(element);
    if (elements.empty()) return;
    Matrix assembled(lower.rows(), lower.cols());
    double seconds = median([&] {
        std::vector<Triplet> triplets;
        triplets.reserve(elements.size());
        for (const Element &e : elements) triplets.emplace_back(e.row, e.column, e.value);
        assembled.setFromTriplets(triplets.begin(), triplets.end());
    });
    double error = (assembled - lower).norm() / lower.norm();
    line("Eigen", "refill A", seconds, ", \"difference\": " + std::to_string(error));
}

static std::string report(double residual, long iterations) {
    std::ostringstream text;
    text << ", \"residual\": " << residual << ", \"iterations\": " << iterations;
    return text.str();
}

template <class Solver> static void eigen_cg(const char *stage, const Matrix &a, const Eigen::VectorXd &b) {
    Solver solver;
    solver.setTolerance(1e-10);
    Eigen::VectorXd x;
    double seconds = median([&] {
        solver.compute(a);
        x = solver.solve(b);
    });
    Eigen::VectorXd r = b - a.template selfadjointView<Eigen::Lower>() * x;
    line("Eigen", stage, seconds, report(r.norm() / b.norm(), solver.iterations()));
}

static void eigen(const Matrix &lower, const Eigen::VectorXd &b, double largest) {
    Matrix whole = lower.selfadjointView<Eigen::Lower>();
    Eigen::VectorXd y(b.size());
    line("Eigen", "product", median([&] { y.noalias() = lower.selfadjointView<Eigen::Lower>() * b; }));
    using Whole = Eigen::ConjugateGradient<Matrix, Eigen::Lower | Eigen::Upper>;
    Eigen::setNbThreads(threads);
    eigen_cg<Whole>("cg jacobi", whole, b);
    using Incomplete = Eigen::ConjugateGradient<Matrix, Eigen::Lower, Eigen::IncompleteCholesky<double>>;
    eigen_cg<Incomplete>("cg incomplete-cholesky", lower, b);
    if (largest < 1e10) return;
    Eigen::SimplicialLLT<Matrix> llt;
    llt.analyzePattern(lower);
    line("Eigen", "factor", median([&] { llt.factorize(lower); }));
    Eigen::VectorXd x;
    line("Eigen", "solve", median([&] { x = llt.solve(b); }));
}

static void cholmod(const Matrix &lower, const Eigen::VectorXd &b, double largest) {
    cholmod_common common;
    cholmod_start(&common);
    common.supernodal = CHOLMOD_SUPERNODAL;
    cholmod_sparse a{};
    a.nrow = a.ncol = lower.rows();
    a.nzmax = lower.nonZeros();
    a.p = const_cast<int *>(lower.outerIndexPtr());
    a.i = const_cast<int *>(lower.innerIndexPtr());
    a.x = const_cast<double *>(lower.valuePtr());
    a.stype = -1;
    a.itype = CHOLMOD_INT;
    a.xtype = CHOLMOD_REAL;
    a.dtype = CHOLMOD_DOUBLE;
    a.sorted = a.packed = 1;
    cholmod_dense rhs{};
    rhs.nrow = rhs.nzmax = rhs.d = b.size();
    rhs.ncol = 1;
    rhs.x = const_cast<double *>(b.data());
    rhs.xtype = CHOLMOD_REAL;
    // Both of its orderings; the one with fewer operations is measured.
    cholmod_factor *best = nullptr;
    double flops = 0, analysis = 0;
    const char *name = "";
    for (auto [ordering, label] : {std::pair{CHOLMOD_AMD, "AMD"}, std::pair{CHOLMOD_METIS, "METIS"}}) {
        common.nmethods = 1;
        common.method[0].ordering = ordering;
        common.postorder = true;
        double start = now();
        cholmod_factor *factor = cholmod_analyze(&a, &common);
        analysis += now() - start;
        if (factor && (!best || common.fl < flops)) {
            if (best) cholmod_free_factor(&best, &common);
            best = factor, flops = common.fl, name = label;
        } else if (factor) {
            cholmod_free_factor(&factor, &common);
        }
    }
    std::ostringstream size;
    size << ", \"flops\": " << flops << ", \"ordering\": \"" << name << "\"";
    line("CHOLMOD", "analyse", analysis, size.str());
    if (best && flops < largest) {
        line("CHOLMOD", "factor", median([&] { cholmod_factorize(&a, best, &common); }), size.str());
        line("CHOLMOD", "solve", median([&] {
                 cholmod_dense *x = cholmod_solve(CHOLMOD_A, best, &rhs, &common);
                 cholmod_free_dense(&x, &common);
             }));
    }
    cholmod_free_factor(&best, &common);
    cholmod_finish(&common);
}

int main(int count, char **arguments) {
    if (count != 7) {
        std::cerr << "peers LIBRARY NAME PARTICLES FOLDER THREADS LARGEST_FACTOR_FLOPS\n";
        return 2;
    }
    scene = arguments[2];
    particles = std::atol(arguments[3]);
    const std::string folder = arguments[4];
    Matrix lower = read_lower(folder);
    Eigen::VectorXd b = read_vector(folder, lower.rows());
    threads = std::atoi(arguments[5]);
    double largest = std::atof(arguments[6]);
    if (std::string(arguments[1]) == "cholmod") {
        cholmod(lower, b, largest);
    } else {
        // Eigen's assembly and factorization have one thread.
        if (threads == 1) eigen_assembly(folder, lower);
        eigen(lower, b, threads == 1 ? largest : 0);
    }
}
