#version 330 core
// Places the wall in the picture through the Kannala-Brandt fisheye and hands on where it is as seen by the projector.
layout(location = 0) in vec3 position;
layout(location = NORMAL_LOC) in vec3 normal;
layout(location = INST_M_LOC) in mat4 inst_m;

uniform mat4 M;                 // chunk to world: the pipe's axes, shifted to the camera's distance
uniform mat4 V;                 // world to camera (z forward, x right, y down)
uniform mat4 projector_world;   // world to projector
uniform vec4 lens;              // fx, fy, cx, cy, px
uniform vec4 lens_k;            // k1 .. k4
uniform vec4 picture;           // skew, width, height, largest range

out vec3 from_projector;
out vec3 normal_projector;
out vec3 world;

void main()
{
    vec4 place = M * inst_m * vec4(position, 1.0);
    world = place.xyz;
    from_projector = (projector_world * place).xyz;
    normal_projector = mat3(projector_world) * normal;
    vec3 seen = (V * place).xyz;
    float rho = length(seen.xy);
    float angle = atan(rho, seen.z);
    float a2 = angle * angle;
    float bent = angle * (1.0 + a2 * (lens_k.x + a2 * (lens_k.y + a2 * (lens_k.z + a2 * lens_k.w))));
    vec2 ray = rho > 0.0 ? bent / rho * seen.xy : vec2(0.0);
    vec2 pixel = vec2(lens.x * ray.x + picture.x * ray.y, lens.y * ray.y) + lens.zw;
    vec2 clip = 2.0 * (pixel + 0.5) / picture.yz - 1.0;
    // With the range as w, what is interpolated along a bore is right to second order under an equidistant lens.
    // The picture's first row is the buffer's first, so nothing is flipped when it is read.
    float range = length(seen);
    gl_Position = vec4(clip, 2.0 * range / picture.w - 1.0, 1.0) * range;
}
