// Primary rays by Embree: what a frame of an LDI has to beat. `headbox report` runs this program beside its own frames, in
// turns, where the variable HEADBOX_EMBREE names it.
//
//     g++ -O3 -march=native -std=c++17 -pthread benches/rivals/embree.cpp -o embree -lembree3
//     HEADBOX_EMBREE=./embree headbox report builtin:interior -o report
//
// (Debian: libembree-dev; with Embree 4, -lembree4.)
//
//     embree TRIANGLES THREADS
//
// TRIANGLES: little-endian u32 number of vertices, u32 number of triangles, f32 x y z a vertex, u32 indices, three a triangle.
// The first line on standard output is the version. Then each line on standard input, "ex ey ez rx ry rz ux uy uz fx fy fz
// focal_px width height" (eye, and the unit vectors to the right, up and forward), is one frame, answered by a line "ms hits":
// the time of the fastest of four ways to ask (single rays, packets of 8, packets of 16, streams; all told that they are
// coherent), each asked once, and how many pixels met something. Rays come in tiles of 4x4 pixels and are made before the
// clock starts; HEADBOX_SIMD=avx2 holds Embree to AVX2, too; what is timed is loading them into Embree's layout, the query, and storing distance and triangle. No colours.
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>
#include <vector>

struct Ray {
    float org[3], dir[3];
};

struct Found {
    float t;
    unsigned triangle;
};

#if RTC_VERSION_MAJOR >= 4
struct Asking {
    RTCIntersectArguments arguments;
    Asking() {
        rtcInitIntersectArguments(&arguments);
        arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
    }
    void one(RTCScene scene, RTCRayHit* q) { rtcIntersect1(scene, q, &arguments); }
    void eight(const int* valid, RTCScene scene, RTCRayHit8* q) { rtcIntersect8(valid, scene, q, &arguments); }
    void sixteen(const int* valid, RTCScene scene, RTCRayHit16* q) { rtcIntersect16(valid, scene, q, &arguments); }
};
#else
struct Asking {
    RTCIntersectContext context;
    Asking() {
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    }
    void one(RTCScene scene, RTCRayHit* q) { rtcIntersect1(scene, &context, q); }
    void eight(const int* valid, RTCScene scene, RTCRayHit8* q) { rtcIntersect8(valid, scene, &context, q); }
    void sixteen(const int* valid, RTCScene scene, RTCRayHit16* q) { rtcIntersect16(valid, scene, &context, q); }
    void many(RTCScene scene, RTCRayHit* q, unsigned count) { rtcIntersect1M(scene, &context, q, count, sizeof(RTCRayHit)); }
};
#endif

static void set(RTCRayHit& q, const Ray& ray) {
    memset(&q, 0, sizeof q);
    q.ray.org_x = ray.org[0], q.ray.org_y = ray.org[1], q.ray.org_z = ray.org[2];
    q.ray.dir_x = ray.dir[0], q.ray.dir_y = ray.dir[1], q.ray.dir_z = ray.dir[2];
    q.ray.tfar = INFINITY, q.ray.mask = ~0u;
    q.hit.geomID = q.hit.primID = q.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
}

static void single(RTCScene scene, const Ray* rays, Found* found, size_t count) {
    Asking asking;
    for (size_t i = 0; i < count; i++) {
        RTCRayHit q;
        set(q, rays[i]);
        asking.one(scene, &q);
        found[i] = {q.ray.tfar, q.hit.primID};
    }
}

template <class Packet, int K, class Query>
static void packets(const Ray* rays, Found* found, size_t count, Query query) {
    alignas(64) int valid[K];
    alignas(64) Packet q;
    for (size_t start = 0; start < count; start += K) {
        for (int k = 0; k < K; k++) {
            const Ray& ray = rays[std::min(start + k, count - 1)];
            valid[k] = start + k < count ? -1 : 0;
            q.ray.org_x[k] = ray.org[0], q.ray.org_y[k] = ray.org[1], q.ray.org_z[k] = ray.org[2];
            q.ray.dir_x[k] = ray.dir[0], q.ray.dir_y[k] = ray.dir[1], q.ray.dir_z[k] = ray.dir[2];
            q.ray.tnear[k] = 0, q.ray.tfar[k] = INFINITY, q.ray.time[k] = 0;
            q.ray.mask[k] = ~0u, q.ray.flags[k] = 0, q.ray.id[k] = 0;
            q.hit.geomID[k] = q.hit.primID[k] = q.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
        }
        query(valid, &q);
        for (int k = 0; k < K && start + k < count; k++) found[start + k] = {q.ray.tfar[k], q.hit.primID[k]};
    }
}

enum Way { SINGLE, EIGHT, SIXTEEN, STREAM, WAYS };

static void trace(Way way, RTCScene scene, const Ray* rays, Found* found, size_t count) {
    Asking asking;
    if (way == SINGLE) single(scene, rays, found, count);
    if (way == EIGHT) packets<RTCRayHit8, 8>(rays, found, count, [&](int* v, RTCRayHit8* q) { asking.eight(v, scene, q); });
    if (way == SIXTEEN) packets<RTCRayHit16, 16>(rays, found, count, [&](int* v, RTCRayHit16* q) { asking.sixteen(v, scene, q); });
#if RTC_VERSION_MAJOR < 4
    if (way == STREAM) {
        const size_t most = 1024;
        std::vector<RTCRayHit> q(most);
        for (size_t start = 0; start < count; start += most) {
            size_t some = std::min(most, count - start);
            for (size_t k = 0; k < some; k++) set(q[k], rays[start + k]);
            asking.many(scene, q.data(), unsigned(some));
            for (size_t k = 0; k < some; k++) found[start + k] = {q[k].ray.tfar, q[k].hit.primID};
        }
    }
#endif
}

// One frame; threads take blocks of rays from a shared counter. Milliseconds.
static double pass(Way way, RTCScene scene, const std::vector<Ray>& rays, std::vector<Found>& found, int threads) {
    const size_t block = 8192;
    std::atomic<size_t> next{0};
    auto work = [&] {
        for (size_t start; (start = next.fetch_add(block)) < rays.size();)
            trace(way, scene, &rays[start], &found[start], std::min(block, rays.size() - start));
    };
    auto started = std::chrono::steady_clock::now();
    std::vector<std::thread> pool;
    for (int t = 1; t < threads; t++) pool.emplace_back(work);
    work();
    for (auto& thread : pool) thread.join();
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started).count();
}

struct Camera {
    double eye[3], right[3], up[3], forward[3], focal_px;
    int width, height;
};

static std::vector<Ray> rays_of(const Camera& k) {
    std::vector<Ray> rays;
    for (int top = 0; top < k.height; top += 4)
        for (int left = 0; left < k.width; left += 4)
            for (int pixel = 0; pixel < 16; pixel++) {
                int column = left + pixel % 4, row = top + pixel / 4;
                if (column >= k.width || row >= k.height) continue;
                double x = column + 0.5 - k.width / 2.0, y = k.height / 2.0 - (row + 0.5), d[3], square = 0;
                for (int i = 0; i < 3; i++) {
                    d[i] = k.focal_px * k.forward[i] + x * k.right[i] + y * k.up[i];
                    square += d[i] * d[i];
                }
                Ray ray;
                for (int i = 0; i < 3; i++) ray.org[i] = float(k.eye[i]), ray.dir[i] = float(d[i] / std::sqrt(square));
                rays.push_back(ray);
            }
    return rays;
}

static RTCScene build(RTCDevice device, FILE* file) {
    unsigned counts[2];
    if (fread(counts, 4, 2, file) != 2) return nullptr;
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_HIGH);
    void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, counts[0]);
    void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, counts[1]);
    if (!vertices || !indices) return nullptr;
    if (fread(vertices, 12, counts[0], file) != counts[0] || fread(indices, 12, counts[1], file) != counts[1]) return nullptr;
    rtcCommitGeometry(geometry);
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

// The instructions that Embree may use: those that HEADBOX_SIMD leaves headbox, so that what is compared stands for one machine.
static const char* instructions() {
    const char* asked = getenv("HEADBOX_SIMD");
    if (!asked || !strcmp(asked, "avx512")) return "";
    if (!strcmp(asked, "avx2")) return "avx2";
    return !strcmp(asked, "sse4.2") ? "sse4.2" : "sse2";
}

int main(int argc, char** argv) {
    if (argc != 3) return fprintf(stderr, "usage: embree TRIANGLES THREADS\n"), 2;
    FILE* file = fopen(argv[1], "rb");
    if (!file) return perror(argv[1]), 1;
    int threads = std::max(1, atoi(argv[2]));
    const char* level = instructions();
    char config[64];
    snprintf(config, sizeof config, "threads=%d%s%s", threads, *level ? ",isa=" : "", level);
    RTCDevice device = rtcNewDevice(config);
    RTCScene scene = build(device, file);
    fclose(file);
    if (!scene) return fprintf(stderr, "%s: not what this program reads\n", argv[1]), 1;
    printf("%s%s%s%s\n", RTC_VERSION_STRING, *level ? " (" : "", level, *level ? ")" : "");
    fflush(stdout);
    Camera k;
    std::vector<Found> found;
    while (scanf("%lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %d %d", k.eye, k.eye + 1, k.eye + 2, k.right, k.right + 1,
                 k.right + 2, k.up, k.up + 1, k.up + 2, k.forward, k.forward + 1, k.forward + 2, &k.focal_px, &k.width,
                 &k.height) == 15) {
        std::vector<Ray> rays = rays_of(k);
        found.assign(rays.size(), Found{});
        double best = INFINITY;
        for (int way = 0; way < WAYS; way++) {
            if (way == STREAM && RTC_VERSION_MAJOR >= 4) continue;
            best = std::min(best, pass(Way(way), scene, rays, found, threads));
        }
        size_t hits = std::count_if(found.begin(), found.end(), [](const Found& f) { return f.triangle != RTC_INVALID_GEOMETRY_ID; });
        printf("%.6f %zu\n", best, hits);
        fflush(stdout);
    }
}
