// Lets torch's autograd know of an accelerator "cuda", and gives it pinned memory.
#include <ATen/detail/CUDAHooksInterface.h>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <mutex>

namespace {
std::mutex lock;
std::map<uintptr_t, size_t> pinned;

void release(void* block) {
  std::lock_guard<std::mutex> guard(lock);
  pinned.erase(reinterpret_cast<uintptr_t>(block));
  std::free(block);
}

struct Pinned final : c10::Allocator {
  c10::DataPtr allocate(size_t size) override {
    void* block = std::aligned_alloc(64, (size + 64) & ~size_t(63));
    std::lock_guard<std::mutex> guard(lock);
    pinned[reinterpret_cast<uintptr_t>(block)] = size;
    return {block, block, &release, c10::Device(c10::DeviceType::CPU)};
  }
  c10::DeleterFnPtr raw_deleter() const override { return &release; }
  void copy_data(void* to, const void* from, size_t size) const override { default_copy_data(to, from, size); }
};
Pinned allocator;
}  // namespace

extern "C" int emulated_is_pinned(uint64_t address) {
  std::lock_guard<std::mutex> guard(lock);
  auto next = pinned.upper_bound(address);
  if (next == pinned.begin()) return 0;
  --next;
  return address < next->first + next->second;
}

struct EmulatedHooks final : at::CUDAHooksInterface {
  EmulatedHooks(at::CUDAHooksArgs) {}
  void init() const override {}
  bool hasCUDA() const override { return true; }
  int getNumGPUs() const override { return 1; }
  c10::DeviceIndex deviceCount() const override { return 1; }
  c10::DeviceIndex current_device() const override { return 0; }
  c10::DeviceIndex getCurrentDevice() const override { return 0; }
  void setCurrentDevice(c10::DeviceIndex) const override {}
  bool hasPrimaryContext(c10::DeviceIndex) const override { return false; }
  bool isAvailable() const override { return true; }
  bool isBuilt() const override { return true; }
  bool isPinnedPtr(const void* address) const override {
    return emulated_is_pinned(reinterpret_cast<uintptr_t>(address));
  }
  c10::Allocator* getPinnedMemoryAllocator() const override { return &allocator; }
};
namespace at {
using ::EmulatedHooks;
C10_REGISTER_CLASS(CUDAHooksRegistry, CUDAHooks, ::EmulatedHooks)
}  // namespace at
