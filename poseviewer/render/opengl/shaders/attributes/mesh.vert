layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 colour;
layout(location = 3) in vec2 uv;

uniform mat4 clip_from_world;
uniform mat3 camera_from_world;

out vec3 seen_normal;
out vec3 seen_colour;
#ifdef NUMBERED
out vec2 seen_uv;
#endif

void main()
{
    gl_Position = clip_from_world * vec4(position, 1.0);
    seen_normal = camera_from_world * normal;
    seen_colour = colour;
#ifdef NUMBERED
    seen_uv = uv;
#endif
}
