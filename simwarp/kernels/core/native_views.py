"""C++ of native functions: how they walk arrays of scratch, world by world on a CPU, element by element on a GPU.

On a CPU an array of one slot is contiguous, and a pointer walks it; loops compile to vector code. On a GPU the slot is
the innermost axis of memory, so that the lanes of a warp, which step a world each, read neighbours; what walks an array
there multiplies by its step. A text begins with `VIEWS` and then uses, for both:

    Floats x = elements(a);     // of an array with one axis; Doubles and Ints alike
    Floats y = row(b, i);       // row i of an array with two axes
    Floats z = flat(b);         // all of it, row after row, where rows are not padded
"""

VIEWS = """
#ifdef __CUDA_ARCH__
    struct Floats {
        float* first;
        int step;
        CUDA_CALLABLE float& operator[](int i) const { return first[(size_t)i * step]; }
        CUDA_CALLABLE Floats operator+(int i) const { return Floats{first + (size_t)i * step, step}; }
    };
    struct Doubles {
        double* first;
        int step;
        CUDA_CALLABLE double& operator[](int i) const { return first[(size_t)i * step]; }
        CUDA_CALLABLE Doubles operator+(int i) const { return Doubles{first + (size_t)i * step, step}; }
    };
    struct Ints {
        int* first;
        int step;
        CUDA_CALLABLE int& operator[](int i) const { return first[(size_t)i * step]; }
        CUDA_CALLABLE Ints operator+(int i) const { return Ints{first + (size_t)i * step, step}; }
    };
    struct Views {
        CUDA_CALLABLE static Floats of(float* first, int bytes) { return {first, bytes / (int)sizeof(float)}; }
        CUDA_CALLABLE static Doubles of(double* first, int bytes) { return {first, bytes / (int)sizeof(double)}; }
        CUDA_CALLABLE static Ints of(int* first, int bytes) { return {first, bytes / (int)sizeof(int)}; }
        CUDA_CALLABLE static float* moved(float* first, size_t bytes) { return (float*)((char*)first + bytes); }
        CUDA_CALLABLE static double* moved(double* first, size_t bytes) { return (double*)((char*)first + bytes); }
        CUDA_CALLABLE static int* moved(int* first, size_t bytes) { return (int*)((char*)first + bytes); }
    };
    auto elements = [](auto& a) { return Views::of(a.data, a.strides[0]); };
    auto row = [](auto& a, int i) { return Views::of(Views::moved(a.data, (size_t)i * a.strides[0]), a.strides[1]); };
    auto flat = [](auto& a) { return Views::of(a.data, a.strides[1]); };
#else
    typedef float* __restrict__ Floats;
    typedef double* __restrict__ Doubles;
    typedef int* __restrict__ Ints;
    auto elements = [](auto& a) { return a.data; };
    auto row = [](auto& a, int i) { return a.data + (size_t)i * (a.strides[0] / sizeof(*a.data)); };
    auto flat = [](auto& a) { return a.data; };
#endif
"""
